//! Small pictures for the report: frames, their ground truth, and results drawn over them.

use super::plan::SceneEntry;
use base64::Engine as _;
use base64::engine::general_purpose::STANDARD;
use image::codecs::jpeg::JpegEncoder;
use image::{ExtendedColorType, ImageEncoder};
use splatseg_dataset::{DatasetSettings, open_scene};
use splatseg_geometry::{CowImage, SegmentMap};
use splatseg_output::segment_color;
use splatseg_report::ScenePicture;

/// Maximum width of a picture, pixels.
const WIDTH: usize = 224;
const JPEG_QUALITY: u8 = 70;
/// Maximum number of frames drawn of a video.
const MAX_FRAMES: usize = 32;
/// Opacity of the segments' colours over the image, percent.
const OPACITY_PERCENT: u32 = 58;

/// The frames of a video to draw: every n-th frame, so that all methods are drawn at the same frames.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct StripFrames {
    step: usize,
}

impl StripFrames {
    /// Selects frames of a video with this many frames.
    pub fn of(frames: usize) -> Self {
        Self { step: frames.div_ceil(MAX_FRAMES).max(1) }
    }

    /// Returns true if the frame at this position is drawn.
    pub fn contains(&self, position: usize) -> bool {
        position.is_multiple_of(self.step)
    }
}

/// Returns pictures of at most `limit` frames of a scene, or none if the scene can no longer be read.
pub fn scene_pictures(entry: &SceneEntry, settings: &DatasetSettings, limit: usize) -> Vec<ScenePicture> {
    // A scene that was deleted after it was measured does not stop the report.
    read(entry, settings, limit).unwrap_or_else(|error| {
        tracing::warn!("{}: no pictures: {error}", entry.path.display());
        Vec::new()
    })
}

/// Reads image and ground truth of at most `limit` of the frames with thumbnails.
fn read(entry: &SceneEntry, settings: &DatasetSettings, limit: usize) -> Result<Vec<ScenePicture>, String> {
    let text = |error: &dyn std::fmt::Display| error.to_string();
    let scene = open_scene(&entry.path, settings).map_err(|error| text(&error))?;
    let selected = settings.selected_frames(scene.frame_count()).map_err(|error| text(&error))?;
    let strip = StripFrames::of(selected.len());
    let drawn = selected.iter().enumerate().filter(|(position, _)| strip.contains(*position));
    let drawn: Vec<usize> = drawn.map(|(_, index)| *index).collect();
    let step = drawn.len().div_ceil(limit.max(1)).max(1);
    let mut pictures = Vec::new();
    for index in drawn.into_iter().step_by(step) {
        // The methods also skipped frames that cannot be read.
        let Ok(frame) = scene.read_recorded(index).and_then(|recorded| settings.framing().apply(recorded.frame)) else {
            continue;
        };
        let truth = scene.read_ground_truth(index).ok().flatten();
        let truth = truth.and_then(|truth| settings.framing().apply_to_labels(truth).ok());
        pictures.push(ScenePicture {
            frame: frame.name().to_owned(),
            image: jpeg_data_uri(frame.color(), None)?,
            ground_truth: truth.map(|truth| jpeg_data_uri(frame.color(), Some(&truth))).transpose()?,
        });
    }
    Ok(pictures)
}

/// Encodes an image as a small JPEG in a `data:` URI. If `segments` are given, they are outlined and tinted in
/// [`segment_color`]. Image and segments must have the same size.
pub fn jpeg_data_uri(color: &CowImage<'_, [u8; 3]>, segments: Option<&SegmentMap>) -> Result<String, String> {
    let (width, height) = color.size();
    let small_width = width.clamp(1, WIDTH);
    let small_height = (height * small_width).div_ceil(width.max(1)).max(1);
    let scale = Scale { from: (width, height), to: (small_width, small_height) };
    let mut pixels = Vec::with_capacity(3 * small_width * small_height);
    for row in 0..small_height {
        for column in 0..small_width {
            let mean = scale.mean(color, column, row);
            pixels.extend(match segments {
                None => mean,
                Some(segments) => scale.tinted(mean, segments, (column, row)),
            });
        }
    }
    let mut jpeg = Vec::new();
    JpegEncoder::new_with_quality(&mut jpeg, JPEG_QUALITY)
        .write_image(&pixels, small_width as u32, small_height as u32, ExtendedColorType::Rgb8)
        .map_err(|error| format!("thumbnail: {error}"))?;
    Ok(format!("data:image/jpeg;base64,{}", STANDARD.encode(jpeg)))
}

/// Maps pixels of the small picture to pixels of the image.
struct Scale {
    from: (usize, usize),
    to: (usize, usize),
}

impl Scale {
    fn columns(&self, column: usize) -> std::ops::Range<usize> {
        column * self.from.0 / self.to.0
            ..((column + 1) * self.from.0 / self.to.0).max(column * self.from.0 / self.to.0 + 1)
    }

    fn rows(&self, row: usize) -> std::ops::Range<usize> {
        row * self.from.1 / self.to.1..((row + 1) * self.from.1 / self.to.1).max(row * self.from.1 / self.to.1 + 1)
    }

    fn mean(&self, color: &CowImage<'_, [u8; 3]>, column: usize, row: usize) -> [u8; 3] {
        let (mut sum, mut count) = ([0u32; 3], 0u32);
        for y in self.rows(row) {
            for pixel in &color.row(y)[self.columns(column)] {
                for (sum, channel) in sum.iter_mut().zip(pixel) {
                    *sum += u32::from(*channel);
                }
                count += 1;
            }
        }
        sum.map(|sum| (sum / count.max(1)) as u8)
    }

    fn id(&self, segments: &SegmentMap, (column, row): (usize, usize)) -> u32 {
        let (columns, rows) = (self.columns(column), self.rows(row));
        segments[((columns.start + columns.end - 1) / 2, (rows.start + rows.end - 1) / 2)]
    }

    fn tinted(&self, color: [u8; 3], segments: &SegmentMap, at: (usize, usize)) -> [u8; 3] {
        let id = self.id(segments, at);
        let right = (at.0 + 1 < self.to.0).then(|| self.id(segments, (at.0 + 1, at.1)));
        let below = (at.1 + 1 < self.to.1).then(|| self.id(segments, (at.0, at.1 + 1)));
        if right.is_some_and(|other| other != id) || below.is_some_and(|other| other != id) {
            return [24; 3];
        }
        let tint = if id == 0 { [128; 3] } else { segment_color(id) };
        std::array::from_fn(|channel| {
            let (below, above) = (u32::from(color[channel]), u32::from(tint[channel]));
            ((below * (100 - OPACITY_PERCENT) + above * OPACITY_PERCENT) / 100) as u8
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use splatseg_geometry::Image;

    #[test]
    fn pictures_of_any_size_can_be_drawn() {
        for (width, height) in [(1, 1), (640, 3), (7, 900), (320, 240)] {
            let uri = jpeg_data_uri(&Image::filled(width, height, [90; 3]), Some(&Image::filled(width, height, 3)));
            assert!(uri.unwrap().starts_with("data:image/jpeg;base64,/9j/"), "{width}x{height}");
        }
    }

    #[test]
    fn long_videos_are_thinned_out() {
        let drawn = |frames: usize| (0..frames).filter(|position| StripFrames::of(frames).contains(*position)).count();
        assert_eq!((drawn(5), drawn(32), drawn(80), drawn(1000)), (5, 32, 27, 32));
    }
}
