//! Splits of objects into pieces.

use super::OracleErrorModel;
use super::decision::Decision;
use super::merge::Group;
use crate::FrameChance;
use rand::RngExt;
use splatseg_geometry::Mask;

/// Fraction of a piece's pixels on one side of a cut.
const CUT_FRACTION: std::ops::Range<f32> = 0.2..0.8;

/// Returns the pieces in which an object or a group is found in this frame; a single one if it is not split.
pub(super) fn split(group: Group, model: &OracleErrorModel, chance: FrameChance) -> Vec<Mask> {
    if model.split_rate == 0.0 {
        return vec![group.mask];
    }
    let mut random = chance.lasting_or_fresh(Decision::Split, group.id, model.persistence);
    if random.random::<f64>() >= model.split_rate {
        return vec![group.mask];
    }
    let part_count = random.random_range(2..=model.max_parts);
    let mut parts = vec![group.mask];
    while parts.len() < part_count {
        let angle = random.random_range(0.0..std::f32::consts::TAU);
        let fraction = random.random_range(CUT_FRACTION);
        // The largest piece is cut next; ties go to the first.
        let Some(index) = (0..parts.len()).max_by_key(|index| (parts[*index].area(), std::cmp::Reverse(*index))) else {
            break;
        };
        let behind = cut(&mut parts[index], angle, fraction);
        parts.push(behind);
    }
    parts.retain(|part| !part.is_empty());
    parts
}

/// Cuts a mask by a straight line perpendicular to the direction `angle` (radians), with a `fraction` of the pixels
/// before it. Removes the pixels behind the line from the mask and returns them. The cut does not depend on the
/// position of the mask in the image, so while the camera moves past an object, the same angle and fraction cut it in
/// the same way.
fn cut(mask: &mut Mask, angle: f32, fraction: f32) -> Mask {
    let (across, down) = (angle.cos(), angle.sin());
    let width = mask.width();
    let mut places: Vec<(f32, usize)> = mask
        .pixel_indices()
        .map(|index| (across * (index % width) as f32 + down * (index / width) as f32, index))
        .collect();
    let before = (fraction * places.len() as f32) as usize;
    if before == 0 {
        return Mask::empty(width, mask.height());
    }
    places.select_nth_unstable_by(before, |a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)));
    let mut behind = Mask::empty(width, mask.height());
    for (_, index) in &places[before..] {
        behind.set(index % width, index / width, true);
    }
    mask.subtract(&behind);
    behind
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_cut_divides_by_its_fraction_wherever_the_mask_is() {
        for shift in [0, 20] {
            let mut mask = Mask::from_fn(60, 30, |column, row| (shift..shift + 20).contains(&column) && row < 10);
            let behind = cut(&mut mask, 0.0, 0.25);
            assert_eq!((mask.area(), behind.area()), (50, 150));
            assert!(mask.contains(shift, 9) && behind.contains(shift + 5, 0));
        }
    }
}
