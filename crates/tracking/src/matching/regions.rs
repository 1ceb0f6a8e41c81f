//! Regions of an image decide together which object they show.

use splatseg_geometry::{SegmentId, SegmentMap};

/// Returns the ids of a frame after each region of `regions` (`[height, width]`, 0 for none) has taken the id that most of
/// its pixels have in `segments`, without those that have none. Ties go to the smaller id. Pixels of no region keep
/// their ids.
///
/// Memory and segmenter disagree in speckles where depth has holes, and in seams of single pixels at borders. What lies
/// in one object for certain shows one id.
pub(crate) fn decided_by_regions(segments: &SegmentMap, regions: &SegmentMap) -> SegmentMap {
    let count = regions.pixels().iter().max().map_or(0, |last| *last as usize + 1);
    let mut counts: Vec<Vec<(SegmentId, u32)>> = vec![Vec::new(); count];
    for (id, region) in segments.pixels().iter().zip(regions.pixels()).filter(|(id, _)| **id != 0) {
        let ids = &mut counts[*region as usize];
        match ids.iter_mut().find(|(known, _)| known == id) {
            Some((_, pixels)) => *pixels += 1,
            None => ids.push((*id, 1)),
        }
    }
    let most = |ids: &Vec<(SegmentId, u32)>| {
        let by_pixels = |(id, pixels): &&(SegmentId, u32)| (*pixels, std::cmp::Reverse(*id));
        ids.iter().max_by_key(by_pixels).map_or(0, |(id, _)| *id)
    };
    let decided: Vec<SegmentId> = counts.iter().map(most).collect();
    SegmentMap::from_fn(segments.width(), segments.height(), |column, row| match regions[(column, row)] {
        0 => segments[(column, row)],
        region => decided[region as usize],
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn row(pixels: &[u32]) -> SegmentMap {
        SegmentMap::from_fn(pixels.len(), 1, |column, _| pixels[column])
    }

    #[test]
    fn a_region_shows_the_id_of_most_of_its_pixels() {
        let decided = |segments: &[u32], regions: &[u32]| decided_by_regions(&row(segments), &row(regions));
        assert_eq!(decided(&[5, 5, 7, 7, 7, 5], &[1, 1, 1, 2, 2, 2]), row(&[5, 5, 5, 7, 7, 7]));
        assert_eq!(decided(&[0, 0, 7, 0], &[1, 1, 1, 2]), row(&[7, 7, 7, 0]), "what has no id does not vote");
        assert_eq!(decided(&[9, 4], &[3, 3]), row(&[4, 4]), "ties go to the smaller id");
        assert_eq!(decided(&[9, 4, 4], &[0, 2, 0]), row(&[9, 4, 4]), "pixels of no region keep their ids");
    }
}
