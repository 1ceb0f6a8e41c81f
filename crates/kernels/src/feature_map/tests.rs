//! Comparison with plain loops in double precision, on every instruction set of the machine.

use super::*;
use crate::{Activation, Instructions};
use proptest::prelude::*;

/// Deterministic values in [-1, 1].
fn noise(len: usize, seed: u32) -> Vec<f32> {
    let mut state = seed.wrapping_mul(2_654_435_761).wrapping_add(12_345);
    (0..len)
        .map(|_| {
            state = state.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
            (state >> 8) as f32 / 8_388_608.0 - 1.0
        })
        .collect()
}

fn noise_map(channels: usize, height: usize, width: usize, seed: u32) -> FeatureMap {
    let mut map = FeatureMap::zeros(channels, height, width);
    let values = noise(channels * height * width, seed);
    for (row, values) in map.rows_mut().flatten().zip(values.chunks_exact(width)) {
        row.copy_from_slice(values);
    }
    map
}

/// The value of a pixel, 0 outside the map.
fn pixel(map: &FeatureMap, channel: usize, row: isize, column: isize) -> f64 {
    let inside = (0..map.height() as isize).contains(&row) && (0..map.width() as isize).contains(&column);
    if inside { f64::from(map.row(channel, row as usize)[column as usize]) } else { 0.0 }
}

#[derive(Clone, Copy, Debug)]
struct Case {
    inputs: usize,
    outputs: usize,
    kernel: usize,
    stride: usize,
    /// Centre of the first output, for stride 2.
    start: [usize; 2],
    size: (usize, usize),
    activation: Activation,
    with_residual: bool,
    seed: u32,
}

impl Case {
    fn weight(&self) -> Vec<f32> {
        noise(self.outputs * self.inputs * self.kernel * self.kernel, self.seed)
    }

    fn input(&self) -> FeatureMap {
        noise_map(self.inputs, self.size.0, self.size.1, self.seed + 2)
    }

    fn residual(&self) -> Option<FeatureMap> {
        let size = [self.size.0 - self.start[0], self.size.1 - self.start[1]].map(|size| size.div_ceil(self.stride));
        self.with_residual.then(|| noise_map(self.outputs, size[0], size[1], self.seed + 3))
    }

    /// Runs twice on the same memory, which is first left over from a larger map.
    fn run(&self, instructions: Instructions, threads: usize) -> FeatureMap {
        let bias = noise(self.outputs, self.seed + 1);
        let layer = MapConvolution::new(&self.weight(), &bias, self.kernel, self.stride, self.activation, instructions);
        let (input, residual) = (self.input(), self.residual());
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        let (mut phases, mut output) = (FeatureMap::zeros(0, 0, 0), FeatureMap::zeros(0, 0, 0));
        pool.install(|| {
            let larger = noise_map(self.inputs, self.size.0 + 1, self.size.1 + 1, 99);
            layer.forward(&larger, None, &mut phases, &mut output);
            layer.forward_from(&input, self.start, residual.as_ref(), &mut phases, &mut output);
        });
        output
    }

    fn check(&self, found: &FeatureMap, what: &str) {
        let (weight, bias, input, residual) =
            (self.weight(), noise(self.outputs, self.seed + 1), self.input(), self.residual());
        let padding = (self.kernel / 2) as isize;
        for channel in 0..self.outputs {
            for row in 0..found.height() {
                for column in 0..found.width() {
                    // Winograd's sums mix a tile's inputs, so errors scale with the sum of the weights rather than with
                    // the terms of one output. Inputs are at most 1.
                    let (mut sum, mut magnitude) = (f64::from(bias[channel]), 1.0);
                    for index in 0..self.inputs * self.kernel * self.kernel {
                        let tap = index % (self.kernel * self.kernel);
                        let y = (row * self.stride + self.start[0] + tap / self.kernel) as isize - padding;
                        let x = (column * self.stride + self.start[1] + tap % self.kernel) as isize - padding;
                        let factor = weight[channel * self.inputs * self.kernel * self.kernel + index];
                        let term = f64::from(factor) * pixel(&input, index / (self.kernel * self.kernel), y, x);
                        (sum, magnitude) = (sum + term, magnitude + f64::from(factor.abs()));
                    }
                    if self.activation == Activation::Silu {
                        sum /= 1.0 + (-sum).exp();
                    }
                    let expected = sum + residual.as_ref().map_or(0.0, |map| f64::from(map.row(channel, row)[column]));
                    let error = (f64::from(found.row(channel, row)[column]) - expected).abs();
                    assert!(
                        error <= 1e-6 * magnitude,
                        "{what}: channel {channel}, ({column}, {row}) is off by {error}"
                    );
                }
            }
        }
        let inside: f64 = found_sum(found);
        let all: f64 = found.values().iter().map(|value| f64::from(value.abs())).sum();
        assert!((all - inside).abs() <= 1e-9 * inside.max(1.0), "{what}: the padding is not zero");
    }
}

/// Sum of the magnitudes of all pixels.
fn found_sum(map: &FeatureMap) -> f64 {
    let rows = (0..map.channels()).flat_map(|channel| (0..map.height()).map(move |row| (channel, row)));
    rows.flat_map(|(channel, row)| map.row(channel, row)).map(|value| f64::from(value.abs())).sum()
}

fn cases() -> impl Strategy<Value = Case> {
    let kernels = prop_oneof![Just((1, 1)), Just((3, 1)), Just((3, 2))];
    (1..20_usize, 1..30_usize, kernels, (1..40_usize, 1..60_usize), any::<([bool; 2], bool, bool, u16)>()).prop_map(
        |(inputs, outputs, (kernel, stride), size, (late, silu, with_residual, seed))| {
            let activation = if silu { Activation::Silu } else { Activation::None };
            let start = |late: bool, size: usize| usize::from(late && stride == 2 && size > 1);
            let start = [start(late[0], size.0), start(late[1], size.1)];
            Case { inputs, outputs, kernel, stride, start, size, activation, with_residual, seed: u32::from(seed) }
        },
    )
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(100))]

    #[test]
    fn equals_the_definition(case in cases(), threads in 1..4_usize) {
        for instructions in Instructions::available() {
            case.check(&case.run(instructions, threads), &format!("{instructions:?} {case:?}"));
        }
    }
}

#[test]
fn threads_do_not_change_a_bit() {
    for (channels, stride, size) in [(24, 1, (120, 160)), (96, 1, (15, 20)), (40, 2, (31, 41))] {
        let case = Case {
            inputs: channels,
            outputs: channels,
            kernel: 3,
            stride,
            start: [0; 2],
            size,
            activation: Activation::Silu,
            with_residual: true,
            seed: 7,
        };
        for instructions in Instructions::available() {
            let alone = case.run(instructions, 1);
            for threads in [2, 3, 8] {
                assert!(alone == case.run(instructions, threads), "{threads} threads, {instructions:?}, {case:?}");
            }
        }
    }
}

#[test]
fn doubling_is_bilinear() {
    let mut small = FeatureMap::zeros(1, 1, 2);
    small.rows_mut().flatten().for_each(|row| row.copy_from_slice(&[0.0, 4.0]));
    let mut map = FeatureMap::zeros(1, 2, 4);
    map.rows_mut().flatten().for_each(|row| row.fill(10.0));
    add_doubled(&small, &mut map, [0; 2], Instructions::best());
    assert_eq!((map.row(0, 0), map.row(0, 1)), (&[10.0, 11.0, 13.0, 14.0][..], &[10.0, 11.0, 13.0, 14.0][..]));
}

#[test]
fn odd_sizes_and_starts_cut_the_doubled_map() {
    let small = noise_map(3, 4, 6, 5);
    let enlarged = |[height, width]: [usize; 2], start: [usize; 2]| {
        let mut map = FeatureMap::zeros(3, height, width);
        add_doubled(&small, &mut map, start, Instructions::best());
        map
    };
    let whole = enlarged([8, 12], [0; 2]);
    for (size, start) in [([7, 12], [0, 0]), ([8, 11], [0, 0]), ([7, 11], [0, 0]), ([9, 12], [1, 0]), ([8, 13], [1, 1])]
    {
        let cut = enlarged(size, start);
        for (channel, row) in (0..3).flat_map(|channel| (0..size[0]).map(move |row| (channel, row))) {
            // Before the start, the first value is repeated.
            let whole = whole.row(channel, row.saturating_sub(start[0]));
            let expected: Vec<f32> = (0..size[1]).map(|column| whole[column.saturating_sub(start[1])]).collect();
            assert_eq!(cut.row(channel, row), expected, "{size:?} from {start:?}, row {row}");
        }
    }
}

#[test]
fn means_exclude_padding() {
    let mut map = FeatureMap::zeros(2, 2, 3);
    map.rows_mut().zip([3.0, -5.0]).for_each(|(rows, value)| rows.for_each(|row| row.fill(value)));
    let means = mean_per_channel(&map);
    assert_eq!((means.row(0, 0), means.row(1, 0)), (&[3.0][..], &[-5.0][..]));
}

#[test]
fn fused_instruction_sets_give_the_same_bits() {
    for (channels, stride, size) in [(24, 1, (31, 41)), (96, 1, (15, 20)), (40, 2, (31, 41)), (5, 1, (9, 70))] {
        for activation in [Activation::None, Activation::Silu] {
            let (kernel, with_residual, seed) = (3, true, 5);
            let (inputs, outputs, start) = (channels, channels, [0; 2]);
            let case = Case { inputs, outputs, kernel, stride, start, size, activation, with_residual, seed };
            let mut fused = Instructions::available();
            // Without fused multiply-add, a product is rounded before it is added.
            fused.retain(|instructions| !matches!(instructions, Instructions::Portable));
            let results = fused.into_iter().map(|instructions| case.run(instructions, 2));
            let results: Vec<FeatureMap> = results.collect();
            assert!(results.windows(2).all(|pair| pair[0] == pair[1]), "{case:?}");
        }
    }
}
