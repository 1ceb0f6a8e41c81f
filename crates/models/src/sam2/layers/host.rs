//! Tensors as slices, for the arithmetic on the CPU that Burn has no operation for.

use burn::backend::{BackendTypes, Flex};
use burn::tensor::{Device, Tensor, TensorData};

/// The elements of a tensor, row-major; on the CPU they are not copied if they already lie like that.
pub(crate) enum HostValues {
    Shared(<Flex as BackendTypes>::FloatTensorPrimitive),
    Copied(Vec<f32>),
}

impl HostValues {
    pub fn from_tensor<const D: usize>(tensor: Tensor<D>) -> Self {
        match tensor.clone().try_into_primitive::<Flex>() {
            Ok(shared) => Self::Shared(shared.to_contiguous()),
            Err(_) => Self::Copied(host(tensor)),
        }
    }

    pub fn as_slice(&self) -> &[f32] {
        match self {
            Self::Shared(tensor) => {
                let start = tensor.layout().start_offset();
                &tensor.storage::<f32>()[start..start + tensor.layout().num_elements()]
            }
            Self::Copied(values) => values,
        }
    }
}

/// The elements of a tensor, row-major, to be changed.
pub(crate) fn host<const D: usize>(tensor: Tensor<D>) -> Vec<f32> {
    tensor.into_data().try_into_vec().expect("the networks compute in float32")
}

/// A tensor of row-major elements.
pub(crate) fn from_host<const D: usize>(values: Vec<f32>, shape: [usize; D], device: &Device) -> Tensor<D> {
    Tensor::from_data(TensorData::new(values, shape), device)
}
