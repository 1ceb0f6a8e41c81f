//! Benchmarks of layers of FastSAM (yolov8x-seg at 640×640), SAM 2.1 tiny and the affinity network (320×240), and of
//! the machine's peak for comparison.
//!
//! `cargo bench -p splatseg-kernels`; the throughput's "elements" are floating-point operations.

use criterion::{Criterion, Throughput, criterion_group, criterion_main};
use pulp::{Arch, Simd, WithSimd};
use splatseg_kernels::convolution::{ConvolutionShape, PackedConvolution};
use splatseg_kernels::depthwise::DepthwiseConvolution;
use splatseg_kernels::feature_map::{FeatureMap, MapConvolution};
use splatseg_kernels::gemm::{LinearChain, PackedLinear};
use splatseg_kernels::{Activation, Instructions};
use std::hint::black_box;

/// (inputs, outputs, kernel, stride, height and width of the input).
const CONVOLUTIONS: [(usize, usize, usize, usize, usize); 7] = [
    (3, 80, 3, 2, 640),
    (80, 80, 3, 1, 160),
    (160, 160, 3, 1, 80),
    (320, 320, 3, 1, 40),
    (320, 320, 3, 1, 20),
    (320, 640, 3, 2, 80),
    (1280, 640, 1, 1, 40),
];

/// (tokens, inputs, outputs); the first three are of EdgeTAM's trunk at 512 pixels.
const LINEAR_LAYERS: [(usize, usize, usize); 8] = [
    (16_384, 48, 96),
    (16_384, 96, 48),
    (4096, 96, 192),
    (4096, 16, 64),
    (65_536, 96, 96),
    (65_536, 96, 288),
    (16_384, 192, 768),
    (4096, 384, 1536),
];

/// Feed-forward parts of EdgeTAM's memory attention at 512 pixels, and of its memory encoder: (tokens, inputs, hidden
/// features, activation).
const FEED_FORWARD: [(usize, usize, usize, Activation); 2] =
    [(1024, 256, 2048, Activation::Relu), (1024, 256, 1024, Activation::Gelu)];

/// Depthwise layers of EdgeTAM's trunk at 512 pixels, and of the memory encoder: (channels, kernel, stride, height and
/// width of the input).
const DEPTHWISE: [(usize, usize, usize, usize); 4] =
    [(48, 3, 1, 128), (48, 3, 2, 128), (192, 3, 1, 32), (256, 7, 1, 32)];

/// Layers of the affinity network: (inputs, outputs, stride, height and width of the output).
const MAP_CONVOLUTIONS: [(usize, usize, usize, usize, usize); 10] = [
    (8, 16, 2, 120, 160),
    (16, 16, 1, 120, 160),
    (16, 32, 2, 60, 80),
    (32, 32, 1, 60, 80),
    (32, 48, 2, 30, 40),
    (48, 48, 1, 30, 40),
    (48, 64, 2, 15, 20),
    (64, 64, 1, 15, 20),
    (64, 96, 2, 8, 10),
    (96, 96, 1, 8, 10),
];

fn noise(len: usize) -> Vec<f32> {
    (0..len).map(|index| (index * 7919 % 2003) as f32 / 1001.0 - 1.0).collect()
}

fn convolutions(criterion: &mut Criterion) {
    for (inputs, outputs, kernel, stride, size) in CONVOLUTIONS {
        let name = format!("convolution {inputs}-{outputs}, {kernel}x{kernel}/{stride}, {size}x{size}");
        let mut group = criterion.benchmark_group(name);
        let operations = 2 * inputs * outputs * (kernel * size / stride).pow(2);
        group.sample_size(20).throughput(Throughput::Elements(operations as u64));
        let shape = ConvolutionShape::new(inputs, outputs, kernel, stride, kernel / 2);
        let weight = noise(outputs * inputs * kernel * kernel);
        let packed =
            PackedConvolution::new(&weight, &vec![0.1; outputs], shape, Activation::Silu, Instructions::best());
        let image = noise(inputs * size * size);
        let len = outputs * shape.output_size([size; 2]).iter().product::<usize>();
        group.bench_function("forward", |bencher| {
            bencher.iter(|| {
                let mut output = vec![0.0; len];
                packed.forward(&[&image], [size; 2], &mut output);
                output
            });
        });
        group.finish();
    }
}

fn map_convolutions(criterion: &mut Criterion) {
    for (inputs, outputs, stride, height, width) in MAP_CONVOLUTIONS {
        let mut group =
            criterion.benchmark_group(format!("map convolution {inputs}-{outputs}/{stride}, {width}x{height}"));
        let operations = 2 * inputs * outputs * 9 * height * width;
        group.sample_size(50).throughput(Throughput::Elements(operations as u64));
        let weight = noise(outputs * inputs * 9);
        let layer =
            MapConvolution::new(&weight, &vec![0.1; outputs], 3, stride, Activation::Silu, Instructions::best());
        let mut input = FeatureMap::zeros(inputs, stride * height, stride * width);
        input.rows_mut().flatten().for_each(|row| row.copy_from_slice(&noise(row.len())));
        let (mut phases, mut output) = (FeatureMap::zeros(0, 0, 0), FeatureMap::zeros(0, 0, 0));
        group.bench_function("forward", |bencher| {
            bencher.iter(|| layer.forward(&input, None, &mut phases, &mut output));
        });
        group.finish();
    }
}

fn linear_layers(criterion: &mut Criterion) {
    for (tokens, inputs, outputs) in LINEAR_LAYERS {
        let mut group = criterion.benchmark_group(format!("linear {tokens}x{inputs}-{outputs}"));
        group.sample_size(20).throughput(Throughput::Elements((2 * tokens * inputs * outputs) as u64));
        let layer = PackedLinear::new(&noise(inputs * outputs), &noise(outputs), Instructions::best());
        let tokens = noise(tokens * inputs);
        let layers = [(&layer, Activation::Gelu)];
        let chain = LinearChain { norm: None, layers: &layers };
        group.bench_function("forward", |bencher| bencher.iter(|| chain.forward(black_box(&tokens), None)));
        group.finish();
    }
}

fn feed_forward(criterion: &mut Criterion) {
    for (tokens, features, hidden, activation) in FEED_FORWARD {
        let mut group = criterion.benchmark_group(format!("feed-forward {tokens}x{features}-{hidden}-{features}"));
        group.sample_size(20).throughput(Throughput::Elements((4 * tokens * features * hidden) as u64));
        let weights = noise(features * hidden);
        let first = PackedLinear::new(&weights, &noise(hidden), Instructions::best());
        let second = PackedLinear::new(&weights, &noise(features), Instructions::best());
        let tokens = noise(tokens * features);
        let layers = [(&first, activation), (&second, Activation::None)];
        let chain = LinearChain { norm: None, layers: &layers };
        group.bench_function("forward", |bencher| bencher.iter(|| chain.forward(black_box(&tokens), None)));
        group.finish();
    }
}

fn depthwise(criterion: &mut Criterion) {
    for (channels, kernel, stride, size) in DEPTHWISE {
        let mut group =
            criterion.benchmark_group(format!("depthwise {channels}, {kernel}x{kernel}/{stride}, {size}x{size}"));
        let outputs = channels * (size / stride).pow(2);
        group.sample_size(50).throughput(Throughput::Elements((2 * outputs * kernel * kernel) as u64));
        let (weight, bias) = (noise(channels * kernel * kernel), noise(channels));
        let layer = DepthwiseConvolution::new(&weight, &bias, kernel, stride, Instructions::best());
        let (input, mut output) = (noise(channels * size * size), vec![0.0; outputs]);
        group.bench_function("forward", |bencher| bencher.iter(|| layer.forward(&input, [size; 2], &mut output)));
        group.finish();
    }
}

/// Independent sums in registers: measures peak speed without memory limits.
struct MultiplyAdds(usize);

/// More than the latency of a multiply-add times the number issued per cycle, yet few enough for 16 registers.
const CHAINS: usize = 12;

impl WithSimd for MultiplyAdds {
    type Output = f32;

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) -> f32 {
        let (factor, term) = (simd.splat_f32s(black_box(0.5)), simd.splat_f32s(black_box(0.25)));
        let mut sums = [simd.splat_f32s(0.0); CHAINS];
        for _ in 0..self.0 {
            for sum in &mut sums {
                *sum = simd.mul_add_f32s(factor, term, *sum);
            }
        }
        sums.into_iter().map(|sum| simd.reduce_sum_f32s(sum)).sum()
    }
}

struct Lanes;

impl WithSimd for Lanes {
    type Output = usize;

    fn with_simd<S: Simd>(self, _: S) -> usize {
        S::F32_LANES
    }
}

fn peak(criterion: &mut Criterion) {
    const REPEATS: usize = 2_000_000;
    let arch = Arch::new();
    let operations = 2 * CHAINS * REPEATS * arch.dispatch(Lanes);
    let mut group = criterion.benchmark_group("peak");
    let all = rayon::current_num_threads();
    for threads in (1..=all).step_by((all - 1).max(1)) {
        group.throughput(Throughput::Elements((operations * threads) as u64));
        group.bench_function(format!("{threads} threads"), |bencher| {
            bencher.iter(|| {
                std::thread::scope(|scope| {
                    for _ in 0..threads {
                        scope.spawn(|| black_box(arch.dispatch(MultiplyAdds(REPEATS))));
                    }
                });
            })
        });
    }
}

criterion_group!(benches, peak, convolutions, map_convolutions, linear_layers, feed_forward, depthwise);
criterion_main!(benches);
