//! Convolutions of yolov8x-seg at 640×640: ours against Burn's, and the machine's peak, which both are a share of.
//!
//! `cargo bench -p splatseg-models --bench convolution`; throughput "elements" are floating-point operations.

use burn::tensor::activation::silu;
use burn::tensor::module::conv2d;
use burn::tensor::ops::ConvOptions;
use burn::tensor::{Device, Distribution, Tensor};
use criterion::{Criterion, Throughput, criterion_group, criterion_main};
use pulp::{Arch, Simd, WithSimd};
use splatseg_models::convolution::{Activation, Convolution, ConvolutionShape};
use std::hint::black_box;

/// (inputs, outputs, kernel, stride, height and width of the input).
const LAYERS: [(usize, usize, usize, usize, usize); 7] = [
    (3, 80, 3, 2, 640),
    (80, 80, 3, 1, 160),
    (160, 160, 3, 1, 80),
    (320, 320, 3, 1, 40),
    (320, 320, 3, 1, 20),
    (320, 640, 3, 2, 80),
    (1280, 640, 1, 1, 40),
];

fn layers(criterion: &mut Criterion) {
    let device = Device::default();
    for (inputs, outputs, kernel, stride, size) in LAYERS {
        let mut group =
            criterion.benchmark_group(format!("{inputs}-{outputs}, {kernel}x{kernel}/{stride}, {size}x{size}"));
        let operations = 2 * inputs * outputs * (kernel * size / stride).pow(2);
        group.sample_size(10).throughput(Throughput::Elements(operations as u64));
        let noise = |shape: [usize; 4]| Tensor::<4>::random(shape, Distribution::Uniform(-1.0, 1.0), &device);
        let image = noise([1, inputs, size, size]);
        let weight = noise([outputs, inputs, kernel, kernel]);
        let values = weight.clone().into_data().try_into_vec::<f32>().expect("weights are f32");
        let shape = ConvolutionShape::new(inputs, outputs, kernel, stride, kernel / 2);
        let ours = Convolution::new(values, vec![0.1; outputs], shape, Activation::Silu, &device);
        group.bench_function("ours", |bencher| bencher.iter(|| ours.forward(image.clone())));
        let bias = Tensor::<1>::full([outputs], 0.1, &device);
        let options = || ConvOptions::new([stride; 2], [kernel / 2; 2], [1; 2], 1);
        group.bench_function("burn", |bencher| {
            bencher.iter(|| silu(conv2d(image.clone(), weight.clone(), Some(bias.clone()), options())))
        });
        group.finish();
    }
}

/// Sums in registers that wait for nothing: what all threads do when memory is no limit.
struct MultiplyAdds(usize);

/// More than the latency of a multiply-add times how many start in a cycle, and few enough for 16 registers.
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
    for threads in [1, rayon::current_num_threads()] {
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

criterion_group!(benches, peak, layers);
criterion_main!(benches);
