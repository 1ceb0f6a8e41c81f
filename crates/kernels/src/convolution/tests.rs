//! Comparison with a plain convolution in double precision, on every instruction set of the machine.

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

    /// Outputs by definition: (value, sum of the magnitudes of its terms).
    fn expected(&self) -> Vec<(f64, f64)> {
        let [height, width] = self.shape.output_size(self.size);
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
                    Activation::Relu | Activation::Gelu | Activation::QuickGelu => unreachable!("not tested here"),
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
        let [height, width] = self.shape.output_size(self.size);
        let packed = PackedConvolution::new(&self.weight, &self.bias, self.shape, self.activation, instructions);
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        let mut output = vec![f32::NAN; self.shape.outputs * height * width];
        pool.install(|| packed.forward(&[&self.image], self.size, &mut output));
        output
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

/// Uses an image of several strips, so that the division among threads depends on their number.
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
