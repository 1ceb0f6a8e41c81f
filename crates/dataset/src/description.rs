//! Summary of a scene, printed before its frames are processed.

use crate::plausibility::warn_once;
use crate::{DatasetSettings, Format, LeftOut, Scene};
use splatseg_geometry::CameraFrame;
use std::fmt;

/// Summary of the data read by a stream of frames. `Display` writes one line, plus one for each source and each kind of
/// frames that have no pose or are skipped.
#[derive(Clone, Debug, PartialEq)]
#[non_exhaustive]
pub struct SceneDescription {
    /// The scene's name.
    pub name: String,
    /// Format of the scene; `None` for a [`Scene`] implemented outside this crate.
    pub format: Option<Format>,
    /// Number of frames in the scene.
    pub frames: usize,
    /// Number of frames selected by the settings.
    pub selected_frames: usize,
    /// Size `(width, height)` of the stored colour images. This and the following fields are `None` if no frame can be
    /// read.
    pub color_size: Option<(usize, usize)>,
    /// Size `(width, height)` of the frames before they are resized and cropped.
    pub original_size: Option<(usize, usize)>,
    /// Size `(width, height)` of the frames.
    pub frame_size: Option<(usize, usize)>,
    /// Smallest and largest depth in the first frame, metres; also `None` if it has no depth at all.
    pub depth_range_m: Option<(f32, f32)>,
    /// True if at least one frame is expected to have a pose.
    pub has_poses: bool,
    /// Frames without a pose in a scene that has others, as far as known.
    pub without_pose: Vec<LeftOut>,
    /// Sources of the scene's data, one line each, if its files do not make them obvious.
    pub sources: Vec<String>,
    /// Frames that were found but skipped.
    pub left_out: Vec<LeftOut>,
}

impl SceneDescription {
    /// Describes a scene before any frame is read.
    pub(crate) fn of(scene: &dyn Scene, selected_frames: usize) -> Self {
        Self {
            name: scene.name().to_owned(),
            format: scene.format(),
            frames: scene.frame_count(),
            selected_frames,
            color_size: None,
            original_size: None,
            frame_size: None,
            depth_range_m: None,
            has_poses: scene.has_poses(),
            without_pose: scene.without_pose().to_vec(),
            sources: scene.sources().to_vec(),
            left_out: scene.left_out().to_vec(),
        }
    }

    /// Adds the sizes and depth range of the first good frame, which has an index in the scene. `original_size` is its size
    /// before framing.
    pub(crate) fn add_first_frame(
        &mut self,
        scene: &dyn Scene,
        (index, first): (usize, &CameraFrame<'_>),
        original_size: Option<(usize, usize)>,
    ) {
        self.color_size = scene.stored_color_size(index).or(original_size);
        self.original_size = original_size;
        self.frame_size = Some((first.width(), first.height()));
        let measured = first.depth().pixels().iter().filter(|depth| **depth > 0.0);
        self.depth_range_m = measured.fold(None, |range, depth| {
            let (nearest, farthest) = range.unwrap_or((*depth, *depth));
            Some((depth.min(nearest), depth.max(farthest)))
        });
    }

    /// Warns if more frames are left out for one reason than are in the scene.
    pub(crate) fn warn_of_left_out(&self) {
        for LeftOut { count, what } in self.left_out.iter().filter(|left_out| left_out.count > self.frames) {
            warn_once(format!(
                "{}: most frames are left out: {} {what}; {} of the scene remain",
                self.name,
                frames(*count),
                self.frames
            ));
        }
    }

    /// Warns if frames are downscaled only because of `max_pixels`.
    pub(crate) fn warn_of_reduction(&self, settings: &DatasetSettings) {
        let Some(original) = self.original_size else { return };
        let reduced = settings.framing().resized(original);
        if settings.resize.is_none() && reduced != original {
            warn_once(format!(
                "{}: frames of {} pixels are reduced to {}, because dataset.max_pixels is {}: set it higher, or choose \
                 a size with --resize",
                self.name,
                Size(original),
                Size(reduced),
                settings.max_pixels
            ));
        }
    }
}

/// A `(width, height)` in pixels.
struct Size((usize, usize));

impl fmt::Display for Size {
    fn fmt(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(formatter, "{}x{}", self.0.0, self.0.1)
    }
}

/// Formats a number of frames: `1 frame`, `2 frames`.
fn frames(count: usize) -> String {
    if count == 1 { "1 frame".to_owned() } else { format!("{count} frames") }
}

impl SceneDescription {
    /// Writes the sizes and depth range of the first good frame.
    fn write_images(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        let (Some(color), Some(original), Some(framed)) = (self.color_size, self.original_size, self.frame_size) else {
            return write!(formatter, "; none of them can be read");
        };
        write!(formatter, "; colour {}", Size(color))?;
        if original != color {
            write!(formatter, ", depth {}", Size(original))?;
        }
        if framed != color {
            write!(formatter, ", used at {}", Size(framed))?;
        }
        match self.depth_range_m {
            Some((nearest, farthest)) => {
                write!(formatter, "; depth of the first frame {nearest:.2} to {farthest:.2} m")
            }
            None => write!(formatter, "; no depth in the first frame"),
        }
    }
}

impl fmt::Display for SceneDescription {
    fn fmt(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(formatter, "{}: ", self.name)?;
        if let Some(format) = self.format {
            write!(formatter, "format {format}, ")?;
        }
        write!(formatter, "{}", frames(self.frames))?;
        if self.selected_frames != self.frames {
            write!(formatter, ", {} used", self.selected_frames)?;
        }
        self.write_images(formatter)?;
        if !self.has_poses {
            write!(formatter, "; no poses")?;
        }
        for source in &self.sources {
            write!(formatter, "\n  {source}")?;
        }
        for LeftOut { count, what } in &self.without_pose {
            write!(formatter, "\n  no pose: {} {what}", frames(*count))?;
        }
        for LeftOut { count, what } in &self.left_out {
            write!(formatter, "\n  left out: {} {what}", frames(*count))?;
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_scene_is_described_in_a_line() {
        let mut description = SceneDescription {
            name: "scene0000_00".to_owned(),
            format: Some(Format::Scannet),
            frames: 5578,
            selected_frames: 279,
            color_size: Some((1296, 968)),
            original_size: Some((640, 480)),
            frame_size: Some((310, 230)),
            depth_range_m: Some((0.8125, 4.2)),
            has_poses: true,
            without_pose: vec![LeftOut { count: 1, what: "without a pose file".to_owned() }],
            sources: vec!["colour: /color".to_owned()],
            left_out: vec![LeftOut { count: 3, what: "without a colour image".to_owned() }],
        };
        assert_eq!(
            description.to_string(),
            "scene0000_00: format scannet, 5578 frames, 279 used; colour 1296x968, depth 640x480, used at 310x230; depth \
             of the first frame 0.81 to 4.20 m\n  colour: /color\n  no pose: 1 frame without a pose file\n  left out: 3 frames without a \
             colour image"
        );
        description.depth_range_m = None;
        description.without_pose.clear();
        description.has_poses = false;
        description.frame_size = None;
        description.frames = 1;
        description.selected_frames = 1;
        description.left_out.clear();
        description.sources.clear();
        assert_eq!(
            description.to_string(),
            "scene0000_00: format scannet, 1 frame; none of them can be read; no poses"
        );
    }
}
