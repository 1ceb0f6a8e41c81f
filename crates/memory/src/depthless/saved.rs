//! Segments without depth as they are saved.

use super::plane::{Plane, Support};
use super::region::Region;
use super::warp::Viewpoint;
use super::{DepthlessSegment, DepthlessSegments, MAX_CONTRADICTIONS, MAX_SEGMENTS};
use glam::Vec3;
use serde::{Deserialize, Serialize};
use splatseg_geometry::{Intrinsics, LocalPose, SegmentId};
use splatseg_input::MemoryLimit;

/// Sides of images are shorter.
const MAX_SIDE: usize = 1 << 16;

/// A segment without depth.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct SavedDepthlessSegment {
    id: SegmentId,
    /// Left, top, width and height of the box of its pixels.
    bounding_box: [usize; 4],
    /// The runs of pixels in the box, see [`Region::runs`].
    runs: Vec<u32>,
    bare: usize,
    inverse_plane: Vec3,
    support: Support,
    intrinsics: Intrinsics,
    #[serde(rename = "world_from_camera")]
    map_from_camera: LocalPose,
    last_seen: u32,
    poor_views: u8,
    contradictions: u8,
}

impl DepthlessSegments {
    /// What is saved.
    pub fn saved(&self) -> Vec<SavedDepthlessSegment> {
        let saved = |segment: &DepthlessSegment| {
            let DepthlessSegment { region, plane, viewpoint, last_seen, poor_views, contradictions } = segment;
            SavedDepthlessSegment {
                id: region.id,
                bounding_box: [region.left, region.top, region.width, region.height],
                runs: region.runs(),
                bare: region.bare,
                inverse_plane: plane.inverse,
                support: plane.support,
                intrinsics: viewpoint.intrinsics,
                map_from_camera: viewpoint.map_from_camera,
                last_seen: *last_seen,
                poor_views: *poor_views,
                contradictions: *contradictions,
            }
        };
        self.segments.iter().map(saved).collect()
    }

    /// What was saved, of a memory that had given ids up to `largest_id` and taken in so many frames.
    ///
    /// # Errors
    /// If no memory can have it, or it would take more memory than the limit.
    pub fn restored(saved: Vec<SavedDepthlessSegment>, largest_id: SegmentId, frames: u32) -> Result<Self, String> {
        if saved.len() > MAX_SEGMENTS {
            return Err(format!("{} segments without depth, expected at most {MAX_SEGMENTS}", saved.len()));
        }
        let pixels = saved.iter().map(|segment| segment.bounding_box[2].saturating_mul(segment.bounding_box[3]) as u64);
        let (pixels, limit) = (pixels.fold(0, u64::saturating_add), MemoryLimit::in_force());
        if pixels > limit {
            return Err(format!("segments without depth of {pixels} pixels, the memory limit is {limit} bytes"));
        }
        let mut segments: Vec<DepthlessSegment> = Vec::with_capacity(saved.len());
        for saved in saved {
            let id = saved.id;
            let is_next = segments.last().is_none_or(|last| last.region.id < id);
            let is_known = (1..=largest_id).contains(&id) && saved.last_seen <= frames;
            let segment = if is_next && is_known { saved.restored() } else { None };
            segments.push(segment.ok_or_else(|| format!("the segment {id} without depth cannot be"))?);
        }
        Ok(Self { segments })
    }
}

impl SavedDepthlessSegment {
    /// The segment, if it can be one.
    fn restored(self) -> Option<DepthlessSegment> {
        let [left, top, width, height] = self.bounding_box;
        if [left, top, width, height].iter().any(|side| *side >= MAX_SIDE) || width == 0 || height == 0 {
            return None;
        }
        let mask = Region::mask_of_runs(&self.runs, width * height)?;
        let area = mask.iter().filter(|is_inside| **is_inside).count();
        let is_possible = (1..=area).contains(&self.bare)
            && self.inverse_plane.is_finite()
            && self.contradictions < MAX_CONTRADICTIONS;
        let intrinsics = self.intrinsics.validated().ok()?;
        is_possible.then_some(DepthlessSegment {
            region: Region { id: self.id, left, top, width, height, mask, area, bare: self.bare },
            plane: Plane { inverse: self.inverse_plane, support: self.support },
            viewpoint: Viewpoint { intrinsics, map_from_camera: self.map_from_camera },
            last_seen: self.last_seen,
            poor_views: self.poor_views,
            contradictions: self.contradictions,
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A segment of six pixels.
    fn segment(id: SegmentId) -> SavedDepthlessSegment {
        SavedDepthlessSegment {
            id,
            bounding_box: [4, 2, 4, 2],
            runs: vec![1, 6, 1],
            bare: 6,
            inverse_plane: Vec3::new(0.1, 0.2, 0.5),
            support: Support::Fit,
            intrinsics: Intrinsics { fx: 50.0, fy: 50.0, cx: 15.5, cy: 11.5, width: 32, height: 24 },
            map_from_camera: LocalPose::IDENTITY,
            last_seen: 7,
            poor_views: 1,
            contradictions: MAX_CONTRADICTIONS - 1,
        }
    }

    fn restored(saved: &[SavedDepthlessSegment]) -> Result<DepthlessSegments, String> {
        DepthlessSegments::restored(saved.to_vec(), 300, 7)
    }

    #[test]
    fn what_was_saved_is_restored() {
        let saved: Vec<SavedDepthlessSegment> = (1..=MAX_SEGMENTS as SegmentId).map(segment).collect();
        assert_eq!(restored(&saved).unwrap().saved(), saved);
        assert!(restored(&[]).unwrap().saved().is_empty());
    }

    #[test]
    fn what_cannot_be_is_refused() {
        assert!(restored(&(1..=MAX_SEGMENTS as SegmentId + 1).map(segment).collect::<Vec<_>>()).is_err());
        for ids in [&[2, 1][..], &[1, 1], &[0], &[301]] {
            assert!(restored(&ids.iter().map(|id| segment(*id)).collect::<Vec<_>>()).is_err(), "{ids:?}");
        }
        let changes: [fn(&mut SavedDepthlessSegment); 10] = [
            |segment| segment.last_seen = 8,
            |segment| segment.bare = 0,
            |segment| segment.bare = 7,
            |segment| segment.inverse_plane.y = f32::NAN,
            |segment| segment.contradictions = MAX_CONTRADICTIONS,
            |segment| segment.runs = vec![1, 6],
            |segment| segment.runs = vec![8],
            |segment| (segment.bounding_box[2], segment.runs) = (0, vec![]),
            |segment| segment.bounding_box[0] = MAX_SIDE,
            |segment| segment.intrinsics.fx = 0.0,
        ];
        for (index, change) in changes.into_iter().enumerate() {
            let mut segment = segment(3);
            change(&mut segment);
            assert!(restored(&[segment]).is_err(), "change {index}");
        }
    }

    #[test]
    fn sizes_are_checked_before_memory_is_taken() {
        let huge = |id| SavedDepthlessSegment { bounding_box: [0, 0, MAX_SIDE - 1, MAX_SIDE - 1], ..segment(id) };
        let error = restored(&(1..=MAX_SEGMENTS as SegmentId).map(huge).collect::<Vec<_>>()).unwrap_err();
        assert!(error.contains("the memory limit is"), "{error}");
    }
}
