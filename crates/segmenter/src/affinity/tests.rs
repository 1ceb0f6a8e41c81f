//! Comparison with PyTorch and the training's inputs (`training/make_test_data.py`), and with greedy merging.

use super::agglomeration::MergeTree;
use super::grid::Grid;
use super::network::{AffinityNetwork, NetworkMemory};
use super::regions::RegionGraph;
use super::resolution::ScaledFrame;
use super::weights::Offset;
use super::*;
use safetensors::tensor::TensorView;
use safetensors::{Dtype, SafeTensors};
use splatseg_geometry::{CameraFrame, CowImage, Image, Intrinsics};
#[cfg(feature = "networks")]
use splatseg_models::device::DeviceName;

const SIZES: [(usize, usize); 4] = [(64, 48), (70, 50), (65, 33), (5, 3)];

struct Golden(Vec<u8>);

impl Golden {
    fn open() -> Self {
        Self(std::fs::read(concat!(env!("CARGO_MANIFEST_DIR"), "/tests/data/affinity.safetensors")).unwrap())
    }

    fn bytes(&self, (width, height): (usize, usize), name: &str) -> Vec<u8> {
        let tensors = SafeTensors::deserialize(&self.0).unwrap();
        tensors.tensor(&format!("{width}x{height}.{name}")).unwrap().data().to_vec()
    }

    fn numbers(&self, size: (usize, usize), name: &str) -> Vec<f32> {
        self.bytes(size, name).as_chunks().0.iter().map(|bytes| f32::from_le_bytes(*bytes)).collect()
    }

    fn frame(&self, size @ (width, height): (usize, usize)) -> ScaledFrame<'static> {
        let depth = self.bytes(size, "depth");
        let depth = depth.as_chunks().0.iter().map(|bytes| i32::from_le_bytes(*bytes) as f32 / 1000.0).collect();
        let camera = self.numbers(size, "camera");
        ScaledFrame {
            color: Image::from_pixels(width, height, self.bytes(size, "rgb").as_chunks().0.to_vec()).unwrap(),
            depth: CowImage::from_pixels(width, height, depth).unwrap(),
            camera: Intrinsics { fx: camera[0], fy: camera[1], cx: camera[2], cy: camera[3], width, height },
        }
    }
}

fn assert_close(map: &FeatureMap, expected: &[f32], tolerance: f32) {
    assert_eq!(map.channels() * map.height() * map.width(), expected.len());
    for (index, expected) in expected.iter().enumerate() {
        let (channel, row) = (index / (map.height() * map.width()), index / map.width() % map.height());
        let (column, found) = (index % map.width(), map.row(channel, row)[index % map.width()]);
        let error = (found - expected).abs();
        assert!(error <= tolerance, "channel {channel}, ({column}, {row}): {found}, expected {expected}");
    }
}

fn map_from_values(values: &[f32], channels: usize, (width, height): (usize, usize)) -> FeatureMap {
    let mut map = FeatureMap::zeros(channels, height, width);
    map.rows_mut().flatten().zip(values.chunks_exact(width)).for_each(|(row, values)| row.copy_from_slice(values));
    map
}

#[test]
fn inputs_are_those_of_the_training() {
    let golden = Golden::open();
    // The map is reused: its old contents must not matter.
    let mut map = FeatureMap::default();
    for size in SIZES {
        inputs::compute(&golden.frame(size), &mut map);
        assert_close(&map, &golden.numbers(size, "inputs"), 1e-4);
    }
}

#[test]
fn without_depth_its_channels_are_zero() {
    let mut frame = Golden::open().frame((64, 48));
    let mut map = FeatureMap::default();
    inputs::compute(&frame, &mut map);
    frame.depth = Image::filled(64, 48, 0.0);
    inputs::compute(&frame, &mut map);
    assert!((3..8).all(|channel| (0..48).all(|row| map.row(channel, row).iter().all(|value| *value == 0.0))));
    assert!(map.row(0, 0).iter().any(|value| *value != 0.0));
}

#[test]
fn log_odds_are_those_of_pytorch() {
    let golden = Golden::open();
    let network = AffinityNetwork::load(&AffinityWeights::BuiltIn).unwrap();
    let mut memory = NetworkMemory::default();
    for size in SIZES {
        let input = map_from_values(&golden.numbers(size, "inputs"), 8, size);
        network.forward(&input, Grid::new((size.1, size.0)), &mut memory).unwrap();
        assert_close(&memory.log_odds, &golden.numbers(size, "log_odds"), 1e-4);
    }
}

#[cfg(feature = "networks")]
#[test]
fn burns_operations_give_the_log_odds_of_pytorch() {
    let golden = Golden::open();
    let network = AffinityNetwork::load_on_device(&AffinityWeights::BuiltIn, &DeviceName::Cpu.open().unwrap()).unwrap();
    let mut memory = NetworkMemory::default();
    for size in SIZES {
        let input = map_from_values(&golden.numbers(size, "inputs"), 8, size);
        network.forward(&input, Grid::new((size.1, size.0)), &mut memory).unwrap();
        assert_close(&memory.log_odds, &golden.numbers(size, "log_odds"), 1e-4);
    }
}

const OFFSETS: [Offset; 5] = [
    Offset { down: 0, right: 1 },
    Offset { down: 1, right: 0 },
    Offset { down: 0, right: 3 },
    Offset { down: 2, right: -2 },
    Offset { down: 3, right: 3 },
];

/// Noisy log-odds of an image with rectangular blobs as objects.
fn noisy_log_odds((width, height): (usize, usize), seed: u32) -> FeatureMap {
    let mut state = seed.wrapping_mul(2_654_435_761).wrapping_add(12_345);
    let mut noise = || {
        state = state.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
        (state >> 8) as f32 / 8_388_608.0 - 1.0
    };
    let object = |column: i32, row: i32| (column / 5 + row / 4) % 3;
    let mut map = FeatureMap::zeros(OFFSETS.len(), height, width);
    for (offset, channel) in OFFSETS.iter().zip(map.rows_mut()) {
        for (row, values) in channel.enumerate() {
            for (column, value) in values.iter_mut().enumerate() {
                let (column, row) = (column as i32, row as i32);
                let same = object(column, row) == object(column + offset.right, row + offset.down);
                *value = if same { 1.5 } else { -2.0 } + 3.0 * noise();
            }
        }
    }
    map
}

/// Reference for merging: repeatedly searches all pairs of regions for the highest mean log-odds.
fn merged_greedily(graph: &RegionGraph, threshold: f32) -> Vec<usize> {
    let count = graph.edges.len();
    let mut region_of: Vec<usize> = (0..count).collect();
    loop {
        let mut sums = std::collections::BTreeMap::new();
        for (region, edges) in graph.edges.iter().enumerate() {
            for edges in edges {
                let pair = (region_of[region], region_of[edges.other as usize]);
                if pair.0 < pair.1 {
                    let sum = sums.entry(pair).or_insert((0, 0));
                    *sum = (sum.0 + edges.sum, sum.1 + i64::from(edges.count));
                }
            }
        }
        let mean = |sum: &(i64, i64)| sum.0 as f64 / sum.1 as f64 / 4096.0;
        match sums.iter().max_by(|a, b| mean(a.1).total_cmp(&mean(b.1))) {
            Some((pair, sum)) if mean(sum) > f64::from(threshold) => {
                region_of.iter_mut().filter(|region| **region == pair.1).for_each(|region| *region = pair.0);
            }
            _ => return region_of,
        }
    }
}

/// Renumbers the parts in the order of their first members.
fn renumbered(parts: impl IntoIterator<Item = usize>) -> Vec<usize> {
    let mut numbers = std::collections::HashMap::new();
    parts
        .into_iter()
        .map(|part| {
            let next = numbers.len();
            *numbers.entry(part).or_insert(next)
        })
        .collect()
}

#[test]
fn chains_merge_as_the_greedy_order_does() {
    for seed in 0..10 {
        for cell in [1, 4] {
            let log_odds = noisy_log_odds((17, 13), seed);
            let graph = RegionGraph::with_cells(&log_odds, &OFFSETS, cell, [0; 2]);
            assert!(cell > 1 || graph.edges.len() == 17 * 13);
            let expected: Vec<Vec<usize>> =
                [-1.5, 0.0, 1.0].map(|threshold| renumbered(merged_greedily(&graph, threshold))).to_vec();
            let tree = MergeTree::new(graph);
            for (threshold, expected) in [-1.5, 0.0, 1.0].into_iter().zip(expected) {
                let found = tree.cut(threshold);
                assert_eq!(renumbered(found.segment_of_region.iter().map(|segment| *segment as usize)), expected);
                assert!(found.scores.iter().all(|score| (0.0..=1.0).contains(score)));
            }
        }
    }
}

#[test]
fn regions_stay_in_their_cells() {
    let sure = map_from_values(&[9.0; 5 * 35], OFFSETS.len(), (7, 5));
    let moved = RegionGraph::with_cells(&sure, &OFFSETS, 4, [1, 2]);
    assert_eq!(moved.labels[..14], [0, 0, 1, 1, 1, 1, 2, 3, 3, 4, 4, 4, 4, 5]);
    let graph = RegionGraph::with_cells(&sure, &OFFSETS, 4, [0; 2]);
    assert_eq!(graph.labels[..14], [0, 0, 0, 0, 1, 1, 1, 0, 0, 0, 0, 1, 1, 1]);
    assert_eq!(graph.edges.len(), 4);
    let tree = MergeTree::new(graph);
    assert_eq!(tree.cut(0.0).segment_of_region, [0; 4]);
    assert_eq!(tree.cut(7.0).segment_of_region, [0, 1, 2, 3]);
}

#[test]
fn threads_do_not_change_a_bit() {
    let scaled = Golden::open().frame((70, 50));
    let frame = CameraFrame::new("0", scaled.color, scaled.depth, scaled.camera).unwrap();
    let segment = |threads: usize| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        let settings = AffinitySettings::default().with(|settings| {
            settings.min_area = 1;
            settings.max_pixels = 3000;
        });
        let mut segmenter =
            AffinitySegmenter::new(AffinityNetwork::load(&AffinityWeights::BuiltIn).unwrap(), settings).unwrap();
        pool.install(|| segmenter.segment(&frame).unwrap().masks)
    };
    let alone = segment(1);
    assert!(!alone.is_empty());
    assert!([2, 3].into_iter().all(|threads| segment(threads) == alone));
}

/// Replaces a text in the header of the built-in weights. Returns the resulting error without the path.
fn changed(from: &str, to: &str) -> String {
    assert_eq!(from.len(), to.len());
    let mut bytes = AffinityWeights::BuiltIn.read().unwrap().0.into_owned();
    let place = bytes.windows(from.len()).position(|part| part == from.as_bytes()).unwrap();
    bytes[place..place + to.len()].copy_from_slice(to.as_bytes());
    error_of(&bytes)
}

/// Gives a tensor of the built-in weights this shape, and half-precision values of these bits. Returns the resulting error
/// without the path.
fn replaced(name: &str, shape: &[usize], bits: u16) -> String {
    let bytes = AffinityWeights::BuiltIn.read().unwrap().0;
    let (_, header) = SafeTensors::read_metadata(&bytes).unwrap();
    let tensors = SafeTensors::deserialize(&bytes).unwrap();
    let values = bits.to_le_bytes().repeat(shape.iter().product());
    let changed = TensorView::new(Dtype::F16, shape.to_vec(), &values).unwrap();
    let tensors = tensors.iter().map(|(other, tensor)| (other, if other == name { changed.clone() } else { tensor }));
    error_of(&safetensors::serialize(tensors, header.metadata().clone()).unwrap())
}

/// The error of a weights file of these bytes, without the path.
fn error_of(bytes: &[u8]) -> String {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("weights.safetensors");
    std::fs::write(&path, bytes).unwrap();
    let error = AffinityNetwork::load(&AffinityWeights::File(path.clone())).unwrap_err().to_string();
    assert!(error.starts_with(path.to_str().unwrap()), "{error}");
    error[path.to_str().unwrap().len()..].to_owned()
}

#[test]
fn built_in_weights_are_small_and_of_one_shape() {
    let networks = [AffinityWeights::BuiltIn, AffinityWeights::NoisyDepth].map(|weights| {
        assert!(weights.read().unwrap().0.len() <= 2 << 20);
        AffinityNetwork::load(&weights).unwrap()
    });
    assert_eq!(networks[0].offsets, networks[1].offsets);
    assert_eq!(networks[0].threshold, networks[1].threshold);
}

#[test]
fn noisy_depth_has_a_network_of_its_own() {
    let network = |weights| AffinityNetwork::load(&weights).unwrap();
    let alone = |weights| AffinitySegmenter::new(network(weights), AffinitySettings::default()).unwrap();
    let (mut usual, mut noisy) = (alone(AffinityWeights::BuiltIn), alone(AffinityWeights::NoisyDepth));
    let mut both = alone(AffinityWeights::BuiltIn).with_noisy_depth(network(AffinityWeights::NoisyDepth));
    let camera = Intrinsics { fx: 100.0, fy: 100.0, cx: 64.0, cy: 48.0, width: 128, height: 96 };
    let frame = |noise: f32| {
        let mut state = 1_u32;
        let depth = Image::from_fn(128, 96, |column, _| {
            state = state.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
            2.0 + column as f32 * 0.01 + noise * (state >> 8) as f32 / (1 << 24) as f32
        });
        let color = Image::from_fn(128, 96, |column, row| [(column * 2) as u8, (row * 2) as u8, 90]);
        CameraFrame::new("0", color, depth, camera).unwrap()
    };
    // From noisy to calm and back: each frame is judged by itself.
    for noise in [0.2, 0.0, 0.2] {
        let frame = frame(noise);
        let found = both.segment(&frame).unwrap();
        let [usual, noisy] = [&mut usual, &mut noisy].map(|segmenter| segmenter.segment(&frame).unwrap());
        assert_ne!(usual.affinities, noisy.affinities);
        assert_eq!(found.affinities, if noise > 0.0 { noisy.affinities } else { usual.affinities });
    }
    let settings = AffinitySettings { noisy_depth: 1e6, ..AffinitySettings::default() };
    let mut calm = AffinitySegmenter::new(network(AffinityWeights::BuiltIn), settings).unwrap();
    calm = calm.with_noisy_depth(network(AffinityWeights::NoisyDepth));
    assert_eq!(calm.segment(&frame(0.2)).unwrap().affinities, usual.segment(&frame(0.2)).unwrap().affinities);
}

#[test]
fn wrong_weights_are_named() {
    let missing = changed("\"d0.1.bias\"", "\"d0.1.bier\"");
    assert_eq!(missing, ": tensor d0.1.bias: found nothing, expected a tensor");
    let shape = changed("[16,8,3,3]", "[16,3,8,3]");
    assert_eq!(shape, ": tensor stem.weight: found shape [16, 3, 8, 3], expected [outputs, 3, 5 or 8, 3, 3]");
    let offsets = changed("[0, 1], [1, 0]", "[0, 1], [0, 0]");
    assert!(offsets.starts_with(": offsets in the metadata: found [[0, 1], [0, 0]"), "{offsets}");
    let upwards = changed("[0, 1], [1, 0]", "[-1,0], [0,-1]");
    assert!(upwards.contains(", expected a list of pairs (row, column): rows down from 0"), "{upwards}");
    assert_eq!(
        replaced("stem.weight", &[0, 8, 3, 3], 0),
        ": tensor stem.weight: found shape [0, 8, 3, 3], expected [outputs, 3, 5 or 8, 3, 3]"
    );
    // 0x7e00 is NaN, 0xfc00 minus infinity.
    assert_eq!(replaced("d0.1.bias", &[1], 0x7e00), ": tensor d0.1.bias: found NaN, expected finite numbers");
    assert_eq!(
        replaced("stem.weight", &[16, 8, 3, 3], 0xfc00),
        ": tensor stem.weight: found -inf, expected finite numbers"
    );
    assert_eq!(changed("-2.25", "-2.x5"), ": threshold in the metadata: found -2.x5, expected a number");
    let nowhere = AffinityNetwork::load(&AffinityWeights::File("nowhere.safetensors".into())).unwrap_err().to_string();
    assert!(nowhere.starts_with("cannot read nowhere.safetensors"), "{nowhere}");
}
