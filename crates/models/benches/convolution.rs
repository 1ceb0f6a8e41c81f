//! Convolutions of yolov8x-seg at 640×640: our kernels compared with Burn's.
//!
//! `cargo bench -p splatseg-models --bench convolution`; the throughput's "elements" are floating-point operations.

use burn::tensor::activation::silu;
use burn::tensor::module::conv2d;
use burn::tensor::ops::ConvOptions;
use burn::tensor::{Device, Distribution, Tensor};
use criterion::{Criterion, Throughput, criterion_group, criterion_main};
use splatseg_models::convolution::{Activation, Convolution, ConvolutionShape};

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
    let device = Device::flex();
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

criterion_group!(benches, layers);
criterion_main!(benches);
