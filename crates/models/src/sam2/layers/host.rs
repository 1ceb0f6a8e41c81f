//! Tensors of the CPU as slices, for the arithmetic that has kernels of its own there.

use burn::backend::{BackendTypes, Flex};
use burn::tensor::{Device, Tensor, TensorData};

/// Where tensors become slices, they are on the CPU.
const ON_CPU: &str = "other devices have a path of their own";

/// The elements of a tensor of the CPU, row-major; they are not copied if they already lie like that.
pub(crate) struct HostValues(<Flex as BackendTypes>::FloatTensorPrimitive);

impl HostValues {
    pub fn from_tensor<const D: usize>(tensor: Tensor<D>) -> Self {
        Self(tensor.try_into_primitive::<Flex>().expect(ON_CPU).to_contiguous())
    }

    pub fn as_slice(&self) -> &[f32] {
        let start = self.0.layout().start_offset();
        &self.0.storage::<f32>()[start..start + self.0.layout().num_elements()]
    }
}

/// The elements of a tensor of the CPU, row-major, to be changed.
pub(crate) fn host<const D: usize>(tensor: Tensor<D>) -> Vec<f32> {
    tensor.into_data().try_into_vec().expect("the networks compute in float32")
}

/// A tensor of row-major elements.
pub(crate) fn from_host<const D: usize>(values: Vec<f32>, shape: [usize; D], device: &Device) -> Tensor<D> {
    Tensor::from_data(TensorData::new(values, shape), device)
}
