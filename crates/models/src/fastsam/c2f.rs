//! C2f: YOLOv8's repeated block.

use super::conv::{ConvShape, FusedConv};
use super::{FastSamError, Weights};
use burn::tensor::{Device, Tensor};

/// Sizes of a [`C2f`].
#[derive(Clone, Copy, Debug)]
pub(super) struct C2fShape {
    pub inputs: usize,
    pub outputs: usize,
    pub bottlenecks: usize,
    /// True if bottlenecks add their input to their output, as in the backbone.
    pub shortcut: bool,
}

/// Ultralytics' `C2f`. The output of a 1×1 convolution is split in two, and bottlenecks are chained on the second half.
/// All outputs are concatenated and passed through another 1×1 convolution.
#[derive(Clone, Debug)]
pub(super) struct C2f {
    entry: FusedConv,
    bottlenecks: Vec<[FusedConv; 2]>,
    exit: FusedConv,
    hidden: usize,
    shortcut: bool,
}

impl C2f {
    pub fn load(weights: &dyn Weights, name: &str, shape: C2fShape, device: &Device) -> Result<Self, FastSamError> {
        let hidden = shape.outputs / 2;
        let conv = |part: &str, shape: ConvShape| {
            FusedConv::batch_normalised(weights, &format!("{name}.{part}"), shape, device)
        };
        let inner = ConvShape::new(hidden, hidden, 3);
        Ok(Self {
            entry: conv("cv1", ConvShape::new(shape.inputs, 2 * hidden, 1))?,
            bottlenecks: (0..shape.bottlenecks)
                .map(|index| Ok([conv(&format!("m.{index}.cv1"), inner)?, conv(&format!("m.{index}.cv2"), inner)?]))
                .collect::<Result<_, FastSamError>>()?,
            exit: conv("cv2", ConvShape::new((2 + shape.bottlenecks) * hidden, shape.outputs, 1))?,
            hidden,
            shortcut: shape.shortcut,
        })
    }

    pub fn forward(&self, input: Tensor<4>) -> Tensor<4> {
        self.forward_joined(vec![input])
    }

    /// Like `forward`, for inputs concatenated along their channels.
    pub fn forward_joined(&self, inputs: Vec<Tensor<4>>) -> Tensor<4> {
        let entered = self.entry.forward_joined(inputs);
        let mut last = entered.clone().narrow(1, self.hidden, self.hidden);
        let mut parts = vec![entered];
        for [first, second] in &self.bottlenecks {
            let output = second.forward(first.forward(last.clone()));
            last = if self.shortcut { output + last } else { output };
            parts.push(last.clone());
        }
        self.exit.forward_joined(parts)
    }
}
