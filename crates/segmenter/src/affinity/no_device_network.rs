//! Stand-in for the network on a device, which needs Burn: the feature `networks`.

use super::grid::Grid;
use super::weights::{AffinityWeightsError, Weights};
use crate::SegmenterError;
use splatseg_kernels::feature_map::FeatureMap;
use splatseg_models::device::{Device, DeviceError};

/// The layers on a device. There are none in a program without networks.
#[derive(Debug)]
pub(super) enum DeviceNetwork {}

impl DeviceNetwork {
    pub fn load(_: &Weights<'_>, _: &Device) -> Result<Self, AffinityWeightsError> {
        Err(DeviceError::NoNetworks.into())
    }

    pub fn outputs(&self) -> usize {
        match *self {}
    }

    pub fn forward(&self, _: &FeatureMap, _: Grid, _: &mut FeatureMap) -> Result<(), SegmenterError> {
        match *self {}
    }
}
