//! Crops of objects, each from the frame with the best view.

use crate::{OutputError, ResultFolder, segment_color};
use splatseg_geometry::{CowImage, Image, SegmentId, SegmentMap};
use splatseg_objects::{BoundingBox, ObjectView};
use std::collections::BTreeMap;
use std::path::PathBuf;

/// Maximum side of a crop, pixels; larger crops are scaled down.
const MAX_SIDE: usize = 256;
/// Brightness of the surroundings, percent of the original.
const SURROUNDINGS_PERCENT: u32 = 45;
const JPEG_QUALITY: u8 = 85;

/// A crop is written when no better view has come for this many frames: most objects get better views at first.
const SETTLED_FRAMES: usize = 10;
/// Memory for pending crops, bytes; beyond it, the oldest are written at once.
const MAX_WAITING_BYTES: usize = 32 << 20;

/// An object cut out of a frame: darkened surroundings, and an outline in its [`segment_color`].
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Crop {
    image: Image<[u8; 3]>,
}

impl Crop {
    /// Cuts object `id` out of a frame. `color` and `segments` are `[height, width]`. `None` if their sizes differ or
    /// `inner`, the box around the object, is empty or not inside them.
    pub fn of(
        color: &CowImage<'_, [u8; 3]>,
        segments: &SegmentMap,
        id: SegmentId,
        inner: &BoundingBox,
    ) -> Option<Self> {
        let ObjectView { mut image, mask } = ObjectView::cut(color, segments, id, inner, MAX_SIDE)?;
        highlight(&mut image, &mask, segment_color(id));
        Some(Self { image })
    }

    fn bytes(&self) -> usize {
        size_of_val(self.image.pixels())
    }

    /// The crop as a JPEG.
    fn encoded(&self, file: &str) -> Result<Vec<u8>, OutputError> {
        splatseg_jpeg::encode(self.image.pixels(), self.image.width(), self.image.height(), JPEG_QUALITY)
            .map_err(|source| OutputError::EncodeJpeg { path: PathBuf::from(file), source })
    }
}

/// Darkens the pixels outside the object and draws an outline on its border pixels.
fn highlight(image: &mut Image<[u8; 3]>, inside: &Image<bool>, outline: [u8; 3]) {
    let (width, height) = inside.size();
    for row in 0..height {
        for column in 0..width {
            let darker = |channel: u8| (u32::from(channel) * SURROUNDINGS_PERCENT / 100) as u8;
            let is_border = || {
                let columns = column.saturating_sub(1)..=(column + 1).min(width - 1);
                let rows = row.saturating_sub(1)..=(row + 1).min(height - 1);
                columns.map(|column| (column, row)).chain(rows.map(|row| (column, row))).any(|at| !inside[at])
            };
            let pixel = &mut image[(column, row)];
            if !inside[(column, row)] {
                *pixel = pixel.map(darker);
            } else if is_border() {
                *pixel = outline;
            }
        }
    }
}

/// The mean sRGB colour of an object's pixels in a frame; `None` if the object has no pixels there because others
/// overlap it.
pub(crate) fn mean_color(
    color: &CowImage<'_, [u8; 3]>,
    segments: &SegmentMap,
    id: SegmentId,
    inner: &BoundingBox,
) -> Option<[u8; 3]> {
    let (mut sum, mut count) = ([0u64; 3], 0u64);
    for row in (inner.y..inner.y + inner.height).take_while(|row| *row < segments.height()) {
        let columns = inner.x.min(segments.width())..(inner.x + inner.width).min(segments.width());
        for (pixel, _) in
            color.row(row)[columns.clone()].iter().zip(&segments.row(row)[columns]).filter(|(_, found)| **found == id)
        {
            sum.iter_mut().zip(pixel).for_each(|(sum, channel)| *sum += u64::from(*channel));
            count += 1;
        }
    }
    (count > 0).then(|| sum.map(|sum| ((sum + count / 2) / count) as u8))
}

/// Crops not yet written. Of several in quick succession, only the last is written.
#[derive(Debug, Default)]
pub(crate) struct WaitingCrops {
    /// For each object, the number of its frame and the crop.
    crops: BTreeMap<SegmentId, (usize, Crop)>,
    bytes: usize,
}

impl WaitingCrops {
    /// Path of an object's crop in the result folder.
    pub fn file(id: SegmentId) -> String {
        format!("objects/{id}.jpg")
    }

    /// Adds a crop, replacing an earlier one of the same object. `frame` is the number of its frame.
    pub fn add(&mut self, id: SegmentId, frame: usize, crop: Crop) {
        self.bytes += crop.bytes();
        if let Some((_, replaced)) = self.crops.insert(id, (frame, crop)) {
            self.bytes -= replaced.bytes();
        }
    }

    /// Drops the crop of an object, if it has not been written.
    pub fn discard(&mut self, id: SegmentId) {
        if let Some((_, crop)) = self.crops.remove(&id) {
            self.bytes -= crop.bytes();
        }
    }

    /// Writes the crops that have waited long enough at frame `now`, and the oldest ones if they take too much memory.
    ///
    /// # Errors
    /// If one cannot be written.
    pub fn write_settled(&mut self, now: usize, folder: &mut dyn ResultFolder) -> Result<(), OutputError> {
        let is_settled = |frame: usize| frame + SETTLED_FRAMES <= now;
        let settled: Vec<SegmentId> =
            self.crops.iter().filter(|(_, (frame, _))| is_settled(*frame)).map(|(id, _)| *id).collect();
        settled.into_iter().try_for_each(|id| self.write(id, folder))?;
        while self.bytes > MAX_WAITING_BYTES {
            let oldest = self.crops.iter().min_by_key(|(_, (frame, _))| *frame).map(|(id, _)| *id);
            let Some(oldest) = oldest else { break };
            self.write(oldest, folder)?;
        }
        Ok(())
    }

    /// Writes all crops.
    ///
    /// # Errors
    /// If one cannot be written.
    pub fn write_all(&mut self, folder: &mut dyn ResultFolder) -> Result<(), OutputError> {
        let ids: Vec<SegmentId> = self.crops.keys().copied().collect();
        ids.into_iter().try_for_each(|id| self.write(id, folder))
    }

    fn write(&mut self, id: SegmentId, folder: &mut dyn ResultFolder) -> Result<(), OutputError> {
        let Some((_, crop)) = self.crops.remove(&id) else { return Ok(()) };
        self.bytes -= crop.bytes();
        let file = Self::file(id);
        folder.write(&file, &crop.encoded(&file)?)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::cell::RefCell;

    /// Records the names of written files, in order.
    #[derive(Default)]
    struct Written(RefCell<Vec<String>>);

    impl ResultFolder for Written {
        fn write(&mut self, file: &str, bytes: &[u8]) -> Result<(), OutputError> {
            assert!(bytes.starts_with(&[0xff, 0xd8]), "not a JPEG");
            self.0.borrow_mut().push(file.to_owned());
            Ok(())
        }

        fn remove(&mut self, _: &str) -> Result<(), OutputError> {
            Ok(())
        }

        fn path_of(&self, file: &str) -> PathBuf {
            PathBuf::from(file)
        }
    }

    fn square(side: usize, id: SegmentId, inner: &BoundingBox) -> (Image<[u8; 3]>, SegmentMap) {
        let inside = |x: usize, y: usize| {
            (inner.x..inner.x + inner.width).contains(&x) && (inner.y..inner.y + inner.height).contains(&y)
        };
        let segments = SegmentMap::from_fn(side, side, |x, y| if inside(x, y) { id } else { 0 });
        (Image::filled(side, side, [200, 100, 40]), segments)
    }

    #[test]
    fn a_crop_shows_the_object_with_an_outline_and_darker_surroundings() {
        let inner = BoundingBox { x: 30, y: 40, width: 20, height: 10 };
        let (color, segments) = square(100, 9, &inner);
        let crop = Crop::of(&color, &segments, 9, &inner).unwrap().image;
        assert_eq!(crop.size(), (28, 18));
        assert_eq!(crop[(0, 0)], [90, 45, 18]);
        assert_eq!(crop[(4, 4)], segment_color(9));
        assert_eq!(crop[(14, 9)], [200, 100, 40]);
        assert_eq!(mean_color(&color, &segments, 9, &inner), Some([200, 100, 40]));
        assert_eq!(mean_color(&color, &segments, 8, &inner), None);
    }

    #[test]
    fn large_objects_are_scaled_down_and_boxes_outside_have_no_crop() {
        let inner = BoundingBox { x: 0, y: 0, width: 1000, height: 300 };
        let (color, segments) = square(1000, 9, &inner);
        assert_eq!(Crop::of(&color, &segments, 9, &inner).unwrap().image.size(), (256, 115));
        for outside in [BoundingBox { x: 1, ..inner }, BoundingBox { width: 0, ..inner }] {
            assert_eq!(Crop::of(&color, &segments, 9, &outside), None);
        }
    }

    #[test]
    fn only_the_last_of_several_crops_is_written() {
        let inner = BoundingBox { x: 2, y: 2, width: 5, height: 5 };
        let (color, segments) = square(20, 9, &inner);
        let crop = Crop::of(&color, &segments, 9, &inner).unwrap();
        let (mut waiting, mut written) = (WaitingCrops::default(), Written::default());
        for frame in 0..30 {
            if frame < 8 || frame == 29 {
                waiting.add(9, frame, crop.clone());
            }
            waiting.write_settled(frame, &mut written).unwrap();
        }
        assert_eq!(*written.0.borrow(), ["objects/9.jpg"]);
        waiting.write_all(&mut written).unwrap();
        assert_eq!((written.0.borrow().len(), waiting.bytes), (2, 0));
    }
}
