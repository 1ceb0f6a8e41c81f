//! CPU tensors as slices, for operations that have their own kernels on the CPU.

use burn::backend::{BackendTypes, Flex};
use burn::tensor::{Device, Tensor, TensorData};

/// Panic message if a tensor that is viewed as a slice is not on the CPU.
const ON_CPU: &str = "other devices have a path of their own";

/// Elements of a CPU tensor, row-major; not copied if they are already contiguous.
pub(crate) struct HostValues(<Flex as BackendTypes>::FloatTensorPrimitive);

impl HostValues {
    pub fn from_tensor<const D: usize>(tensor: Tensor<D>) -> Self {
        // Callers take this path on the CPU only; other devices use tensor operations.
        Self(tensor.try_into_primitive::<Flex>().expect(ON_CPU).to_contiguous())
    }

    pub fn as_slice(&self) -> &[f32] {
        let start = self.0.layout().start_offset();
        &self.0.storage::<f32>()[start..start + self.0.layout().num_elements()]
    }
}

/// Returns the elements of a CPU tensor as a row-major vector.
pub(crate) fn host<const D: usize>(tensor: Tensor<D>) -> Vec<f32> {
    // Weights are converted to float32 when they are read, and no layer changes the type.
    tensor.into_data().try_into_vec().expect("the networks compute in float32")
}

/// Creates a tensor from row-major elements.
pub(crate) fn from_host<const D: usize>(values: Vec<f32>, shape: [usize; D], device: &Device) -> Tensor<D> {
    Tensor::from_data(TensorData::new(values, shape), device)
}
