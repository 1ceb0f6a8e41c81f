//! The CPU path against a plain convolution in double precision, on every instruction set of the machine.

use super::*;
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

struct Case {
    shape: ConvolutionShape,
    size: [usize; 2],
    activation: Activation,
    weight: Vec<f32>,
    bias: Vec<f32>,
    image: Vec<f32>,
}

impl Case {
    fn new(shape: ConvolutionShape, size: [usize; 2], activation: Activation, seed: u32) -> Self {
        let taps = if shape.doubling { 4 } else { shape.kernel * shape.kernel };
        Self {
            shape,
            size,
            activation,
            weight: noise(shape.outputs * shape.inputs * taps, seed),
            bias: noise(shape.outputs, seed + 1),
            image: noise(shape.inputs * size[0] * size[1], seed + 2),
        }
    }

    /// Output (value, sum of the magnitudes of its terms) by the definition.
    fn expected(&self) -> Vec<(f64, f64)> {
        let [height, width] = self.shape.output_size(self.size).map(|size| size * self.shape.scale());
        let mut outputs = Vec::with_capacity(self.shape.outputs * height * width);
        for channel in 0..self.shape.outputs {
            for (y, x) in (0..height).flat_map(|y| (0..width).map(move |x| (y, x))) {
                let bias = f64::from(self.bias[channel]);
                let (sum, magnitude) = self
                    .terms(channel, y, x)
                    .fold((bias, bias.abs()), |(sum, magnitude), term| (sum + term, magnitude + term.abs()));
                outputs.push(match self.activation {
                    Activation::None => (sum, magnitude),
                    Activation::Silu => (sum / (1.0 + (-sum).exp()), magnitude),
                    Activation::Relu | Activation::Gelu => unreachable!("not tested here"),
                });
            }
        }
        outputs
    }

    fn terms(&self, channel: usize, y: usize, x: usize) -> impl Iterator<Item = f64> + '_ {
        let ConvolutionShape { inputs, outputs, kernel, stride, padding, doubling } = self.shape;
        let [height, width] = self.size;
        let taps = if doubling { 1 } else { kernel };
        (0..inputs * taps * taps).filter_map(move |index| {
            let (input, ky, kx) = (index / (taps * taps), index / taps % taps, index % taps);
            let (weight, row, column) = if doubling {
                (((input * outputs + channel) * 2 + y % 2) * 2 + x % 2, Some(y / 2), Some(x / 2))
            } else {
                let weight = ((channel * inputs + input) * kernel + ky) * kernel + kx;
                (weight, (y * stride + ky).checked_sub(padding), (x * stride + kx).checked_sub(padding))
            };
            let (row, column) = (row.filter(|row| *row < height)?, column.filter(|column| *column < width)?);
            let pixel = self.image[(input * height + row) * width + column];
            Some(f64::from(self.weight[weight]) * f64::from(pixel))
        })
    }

    fn run(&self, instructions: Instructions, threads: usize) -> Vec<f32> {
        let [height, width] = self.shape.output_size(self.size).map(|size| size * self.shape.scale());
        let packed = Parameters::packed(&self.weight, &self.bias, self.shape, self.activation, instructions);
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        filled(self.shape.outputs * height * width, |output| {
            pool.install(|| match &packed {
                Parameters::Direct(packed) => packed.forward(&[&self.image], self.size, output),
                Parameters::Winograd(packed) => packed.forward(&[&self.image], self.size, output),
                Parameters::Tensors(_) => unreachable!("these are packed"),
            })
        })
    }
}

fn assert_close(found: &[f32], expected: &[(f64, f64)], what: &str) {
    assert_eq!(found.len(), expected.len());
    for (index, (found, (expected, magnitude))) in found.iter().zip(expected).enumerate() {
        let error = (f64::from(*found) - expected).abs();
        assert!(error <= 2e-6 * magnitude + 1e-6, "{what}: output {index} is {found}, expected {expected}");
    }
}

fn shapes() -> impl Strategy<Value = ConvolutionShape> {
    let ordinary = (1..20_usize, 1..30_usize, 1..5_usize, 1..4_usize)
        .prop_flat_map(|(inputs, outputs, kernel, stride)| (Just((inputs, outputs, kernel, stride)), 0..kernel))
        .prop_map(|((inputs, outputs, kernel, stride), padding)| {
            ConvolutionShape::new(inputs, outputs, kernel, stride, padding)
        });
    let doubling = (1..20_usize, 1..20_usize).prop_map(|(inputs, outputs)| ConvolutionShape::doubling(inputs, outputs));
    prop_oneof![4 => ordinary, 1 => doubling]
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(150))]

    #[test]
    fn equals_the_definition(
        shape in shapes(),
        height in 4..40_usize,
        width in 4..70_usize,
        silu in any::<bool>(),
        threads in 1..4_usize,
        seed in any::<u16>(),
    ) {
        let activation = if silu { Activation::Silu } else { Activation::None };
        let case = Case::new(shape, [height, width], activation, u32::from(seed));
        let expected = case.expected();
        for instructions in Instructions::available() {
            assert_close(&case.run(instructions, threads), &expected, &format!("{instructions:?} {shape:?}"));
        }
    }
}

/// An image that takes several strips, so that what threads get depends on their number.
#[test]
fn threads_do_not_change_a_bit() {
    for shape in [ConvolutionShape::new(512, 9, 3, 1, 1), ConvolutionShape::new(256, 9, 3, 2, 1)] {
        let case = Case::new(shape, [22, 30], Activation::Silu, 7);
        for instructions in Instructions::available() {
            let bits =
                |threads| case.run(instructions, threads).iter().map(|value| value.to_bits()).collect::<Vec<_>>();
            let alone = bits(1);
            for threads in [2, 3, 8] {
                assert!(alone == bits(threads), "{threads} threads, {instructions:?}, {shape:?}");
            }
        }
    }
}

/// Both ways through the public interface: several inputs, views of larger tensors, more than one image.
#[test]
fn joined_views_equal_burns_own_convolution() {
    let device = Device::default();
    let shape = ConvolutionShape::new(12, 9, 3, 2, 1);
    let (weight, bias) = (noise(9 * 12 * 9, 1), noise(9, 2));
    let image = Tensor::<4>::from_data(TensorData::new(noise(2 * 20 * 15 * 17, 3), [2, 20, 15, 17]), &device);
    let inputs = vec![
        image.clone().narrow(1, 3, 5),
        image.clone().narrow(1, 11, 4),
        image.narrow(1, 0, 3).swap_dims(2, 3).mul_scalar(0.5).swap_dims(2, 3),
    ];
    let ours = Convolution::new(weight.clone(), bias.clone(), shape, Activation::Silu, &device);
    assert!(matches!(ours.parameters, Parameters::Direct(_)));
    let burns = Convolution {
        parameters: Parameters::Tensors(Box::new(ConvolutionTensors {
            weight: Tensor::from_data(TensorData::new(weight, [9, 12, 3, 3]), &device),
            bias: Tensor::from_data(TensorData::new(bias, [9]), &device),
        })),
        ..ours.clone()
    };
    let ours = ours.forward_joined(inputs.clone());
    assert_eq!(ours.dims(), [2, 9, 8, 9]);
    let difference = (ours - burns.forward_joined(inputs)).abs().max().into_scalar::<f32>();
    assert!(difference < 1e-5, "{difference}");
}

/// Padding as large as the kernel does not fit the strips' layout; a doubling convolution through Burn is the same too.
#[test]
fn other_shapes_go_through_burn() {
    let device = Device::default();
    let wide =
        Convolution::new(noise(6, 1), noise(2, 2), ConvolutionShape::new(3, 2, 1, 1, 1), Activation::None, &device);
    assert!(matches!(wide.parameters, Parameters::Tensors(_)));
    let image = Tensor::<4>::from_data(TensorData::new(noise(3 * 4 * 5, 3), [1, 3, 4, 5]), &device);
    assert_eq!(wide.forward(image.clone()).dims(), [1, 2, 6, 7]);

    let shape = ConvolutionShape::doubling(3, 5);
    let (weight, bias) = (noise(60, 4), noise(5, 5));
    let ours = Convolution::new(weight.clone(), bias.clone(), shape, Activation::None, &device);
    let parameters = Parameters::Tensors(Box::new(ConvolutionTensors {
        weight: Tensor::from_data(TensorData::new(weight, [3, 5, 2, 2]), &device),
        bias: Tensor::from_data(TensorData::new(bias, [5]), &device),
    }));
    let burns = Convolution { parameters, ..ours.clone() };
    let difference = (ours.forward(image.clone()) - burns.forward(image)).abs().max().into_scalar::<f32>();
    assert!(difference < 1e-5, "{difference}");
}
