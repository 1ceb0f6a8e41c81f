//! Prompts on a result: which of the masks a point or a box means.
//!
//! The rules of FastSAM (`FastSAMPredictor.prompt` of Ultralytics; `FastSAMPrompt` of CASIA-IVA-Lab/FastSAM): prompts
//! choose among the masks of the whole image, the network is not run again.

use splatseg_geometry::Mask;

/// A pixel that belongs to what is meant, or that does not.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct PointPrompt {
    /// Column in pixels.
    pub column: usize,
    /// Row in pixels.
    pub row: usize,
    /// Whether the pixel belongs to what is meant.
    pub positive: bool,
}

/// Places of the masks that contain a pixel (column, row).
///
/// # Panics
/// If the pixel lies outside a mask's image.
pub fn masks_at(masks: &[&Mask], (column, row): (usize, usize)) -> impl Iterator<Item = usize> {
    masks.iter().enumerate().filter(move |(_, mask)| mask.contains(column, row)).map(|(index, _)| index)
}

/// Which masks points mean: those that contain a positive point; a point decides about all masks that contain it, and
/// later points overrule earlier ones. If no point is positive, everything is meant that contains none of them.
///
/// # Panics
/// If a point lies outside a mask's image.
pub fn masks_of_points(masks: &[&Mask], points: &[PointPrompt]) -> Vec<bool> {
    let only_negative = points.iter().all(|point| !point.positive);
    let mut meant = vec![only_negative; masks.len()];
    for point in points {
        for index in masks_at(masks, (point.column, point.row)) {
            meant[index] = point.positive;
        }
    }
    meant
}

/// The mask with the largest IoU with a box (left, top, right, bottom, in whole pixels; the last two are exclusive); the
/// first of equal ones, `None` if there are no masks.
pub fn mask_of_box(masks: &[&Mask], [left, top, right, bottom]: [usize; 4]) -> Option<usize> {
    let box_area = right.saturating_sub(left) * bottom.saturating_sub(top);
    let mut best: Option<(f64, usize)> = None;
    for (index, mask) in masks.iter().enumerate() {
        let inside = |pixel: &usize| {
            let (column, row) = (pixel % mask.width(), pixel / mask.width());
            (left..right).contains(&column) && (top..bottom).contains(&row)
        };
        let intersection = mask.pixel_indices().filter(inside).count();
        let union = box_area + mask.area() - intersection;
        let iou = intersection as f64 / union.max(1) as f64;
        if best.is_none_or(|(highest, _)| iou > highest) {
            best = Some((iou, index));
        }
    }
    best.map(|(_, index)| index)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Columns from..to of an image of 6×2 pixels.
    fn stripe(from: usize, to: usize) -> Mask {
        Mask::from_fn(6, 2, |column, _| (from..to).contains(&column))
    }

    fn point(column: usize, positive: bool) -> PointPrompt {
        PointPrompt { column, row: 1, positive }
    }

    #[test]
    fn points_mean_the_masks_that_contain_them() {
        let masks = [stripe(0, 3), stripe(2, 5), stripe(5, 6)];
        let masks: Vec<&Mask> = masks.iter().collect();
        assert_eq!(masks_at(&masks, (2, 0)).collect::<Vec<_>>(), [0, 1]);
        assert_eq!(masks_of_points(&masks, &[point(2, true)]), [true, true, false]);
        assert_eq!(masks_of_points(&masks, &[point(2, true), point(4, false)]), [true, false, false]);
        assert_eq!(masks_of_points(&masks, &[point(4, false), point(2, true)]), [true, true, false]);
        assert_eq!(masks_of_points(&masks, &[point(4, false)]), [true, false, true]);
    }

    #[test]
    fn a_box_means_the_mask_that_fills_it_best() {
        let masks = [stripe(0, 6), stripe(1, 3), stripe(2, 5)];
        let masks: Vec<&Mask> = masks.iter().collect();
        assert_eq!(mask_of_box(&masks, [1, 0, 3, 2]), Some(1));
        assert_eq!(mask_of_box(&masks, [0, 0, 6, 2]), Some(0));
        assert_eq!(mask_of_box(&masks, [3, 0, 5, 1]), Some(2));
        assert_eq!(mask_of_box(&[], [0, 0, 6, 2]), None);
    }
}
