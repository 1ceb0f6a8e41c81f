//! Rendered rooms as scenes.

use crate::files::MemoryRequirement;
use crate::own_camera::{self, OwnCamera};
use crate::scene::{FramePart, FrameParts};
use crate::{DatasetError, DatasetSettings, Format, RecordedFrame, Scene};
use glam::DVec3;
use splatseg_geometry::{Intrinsics, SegmentMap};
use splatseg_synthetic::{SyntheticScene, SyntheticSettings};
use std::path::{Path, PathBuf};
use std::sync::Arc;

/// Syntax of a synthetic scene's name, for messages.
pub(crate) const LAYOUT: &str = SyntheticSettings::SYNTAX;

/// Returns true if a path is the name of a synthetic scene.
pub(crate) fn looks_like(path: &Path) -> bool {
    path.to_str().is_some_and(SyntheticSettings::are_meant_by)
}

/// Opens the scene of this name. The settings may state another camera than the one that frames are rendered with.
///
/// # Errors
/// [`DatasetError::MemoryLimit`] if its frames are too large; [`DatasetError::Synthetic`] for a wrong name.
pub(crate) fn open(path: &Path, settings: &DatasetSettings) -> Result<Arc<dyn Scene>, DatasetError> {
    let scene_settings: SyntheticSettings = path.to_string_lossy().parse()?;
    let requirement = MemoryRequirement {
        what: "frame",
        size: (scene_settings.width, scene_settings.height),
        bytes_per_pixel: SyntheticScene::RENDERING_BYTES_PER_PIXEL,
        remedy: "choose a smaller width and height, or raise --memory-limit",
    };
    requirement.check(path)?;
    let scene = SyntheticScene::new(scene_settings)?;
    Ok(Arc::new(match OwnCamera::from_settings(settings)? {
        Some(camera) => {
            let Intrinsics { width, height, .. } = scene.intrinsics();
            scene.with_stated_intrinsics(camera.intrinsics((width, height)))
        }
        None => scene,
    }))
}

impl Scene for SyntheticScene {
    fn name(&self) -> &str {
        self.name()
    }

    fn frame_count(&self) -> usize {
        self.settings().frames
    }

    fn frame_name(&self, index: usize) -> String {
        if index < self.frame_count() { format!("frame-{index:06}") } else { String::new() }
    }

    fn read_recorded(&self, index: usize) -> Result<RecordedFrame, DatasetError> {
        check_index(self, index)?;
        let (color, depth) = self.images(index);
        let (name, intrinsics) = (self.frame_name(index), self.stated_intrinsics().unwrap_or(self.intrinsics()));
        let world_from_camera = Some(self.pose(index));
        FrameParts { name, timestamp: None, color, depth, intrinsics, world_from_camera }.into_frame()
    }

    fn world_up(&self) -> Option<DVec3> {
        Some(DVec3::Z)
    }

    fn has_ground_truth(&self) -> bool {
        true
    }

    fn read_ground_truth(&self, index: usize) -> Result<Option<SegmentMap>, DatasetError> {
        check_index(self, index)?;
        Ok(Some(self.segments(index)))
    }

    fn format(&self) -> Option<Format> {
        Some(Format::Synthetic)
    }

    fn file_of(&self, index: usize, part: FramePart) -> PathBuf {
        match self.stated_intrinsics() {
            Some(_) if part == FramePart::Intrinsics => own_camera::PLACE.into(),
            _ => PathBuf::from(format!("{}: frame {}", self.name(), self.frame_name(index))),
        }
    }
}

fn check_index(scene: &SyntheticScene, index: usize) -> Result<(), DatasetError> {
    let count = scene.settings().frames;
    if index < count {
        return Ok(());
    }
    Err(DatasetError::NoSuchFrame { scene: scene.name().to_owned(), index, count })
}
