//! Whether the unit of depth is plausible, and which one is likely.

use crate::{DoubtKind, InputDoubt};
use splatseg_geometry::CameraFrame;

/// Plausible median depth in rooms, metres.
const USUAL_DEPTH: std::ops::RangeInclusive<f32> = 0.3..=15.0;

/// A likely unit makes the median depth one of these, metres.
const LIKELY_DEPTH: std::ops::RangeInclusive<f32> = 0.5..=6.0;

/// The unit of depth is judged by this many frames with depth; at the end by fewer.
const DEPTH_FRAMES: usize = 8;

/// A frame's depth is judged by every Nth pixel: a prime, so that all columns count.
const DEPTH_SAMPLING: usize = 97;

/// Numbers of units of stored depth per metre that are mistaken for each other: true, then assumed. The first one that
/// makes the depth that of a room is named, so common ones come first.
const MISTAKEN_UNITS: [(f64, f64); 12] = [
    (1000.0, 5000.0),
    (5000.0, 1000.0),
    (1.0, 1000.0),
    (1000.0, 1.0),
    (10_000.0, 1000.0),
    (1000.0, 10_000.0),
    (4000.0, 1000.0),
    (1000.0, 4000.0),
    (6553.5, 1000.0),
    (1000.0, 6553.5),
    (1_000_000.0, 1000.0),
    (100.0, 1000.0),
];

/// A measured factor is that of mistaken units if it differs from it by less than this factor.
const SAME_FACTOR: f64 = 1.2;

/// The middle one of the values, the upper of two; `None` without any.
pub(super) fn median(mut values: Vec<f64>) -> Option<f64> {
    values.sort_by(f64::total_cmp);
    values.get(values.len() / 2).copied()
}

/// Median depth of a frame, metres. `None` if it has no depth.
pub(super) fn median_depth(frame: &CameraFrame<'_>) -> Option<f32> {
    let pixels = frame.depth().pixels();
    // Small images have few pixels.
    let sampling = DEPTH_SAMPLING.min(pixels.len().div_ceil(100)).max(1);
    let measured = pixels.iter().step_by(sampling).filter(|depth| **depth > 0.0 && depth.is_finite());
    median(measured.map(|depth| f64::from(*depth)).collect()).map(|depth| depth as f32)
}

/// A mistake about units by which depth would have to be multiplied by about `factor`: the true and the assumed number of
/// stored units per metre.
pub(super) fn mistaken_unit(factor: f64) -> Option<(f64, f64)> {
    let off = |(is, assumed): &(f64, f64)| (factor * is / assumed).ln().abs();
    let nearest = MISTAKEN_UNITS.into_iter().min_by(|one, other| off(one).total_cmp(&off(other)))?;
    (off(&nearest) < SAME_FACTOR.ln()).then_some(nearest)
}

/// Advice if depth has to be multiplied by `factor`.
pub(super) fn remedy(factor: f64) -> String {
    match mistaken_unit(factor) {
        Some((is, assumed)) => format!(
            "set dataset.depth_scale, the stored units per metre, to {} times its value, e.g. {is} instead of {assumed}",
            rounded(is / assumed)
        ),
        None => {
            format!("set dataset.depth_scale, the stored units per metre, to {} times its value", rounded(1.0 / factor))
        }
    }
}

/// A number with three significant digits.
pub(super) fn rounded(value: f64) -> String {
    let digits = 2 - value.abs().log10().floor().clamp(-9.0, 9.0) as i32;
    let text = format!("{value:.*}", usize::try_from(digits).unwrap_or(0));
    if text.contains('.') { text.trim_end_matches('0').trim_end_matches('.').to_owned() } else { text }
}

/// Median depths of the first frames.
#[derive(Clone, Debug, Default)]
pub(super) struct UsualDepth {
    medians: Vec<f32>,
    is_told: bool,
}

impl UsualDepth {
    /// Adds a frame, unless there are enough. Returns a doubt with the frame that completes them.
    pub(super) fn add(&mut self, frame: &CameraFrame<'_>) -> Option<InputDoubt> {
        if self.medians.len() >= DEPTH_FRAMES {
            return None;
        }
        self.medians.extend(median_depth(frame));
        if self.medians.len() >= DEPTH_FRAMES { self.doubt() } else { None }
    }

    /// A sentence about a wrong unit of depth, if depth is not that of a room; once.
    pub(super) fn doubt(&mut self) -> Option<InputDoubt> {
        let found = median(self.medians.iter().map(|depth| f64::from(*depth)).collect()).map(|depth| depth as f32);
        let found = found.filter(|depth| !USUAL_DEPTH.contains(depth) && !self.is_told)?;
        self.is_told = true;
        let mut mistakes = MISTAKEN_UNITS.iter().map(|(is, assumed)| assumed / is);
        let likely = mistakes.find(|factor| LIKELY_DEPTH.contains(&(found * *factor as f32)));
        let remedy = likely.map_or_else(String::new, |factor| {
            format!("; it would be {} m if you {}", rounded(f64::from(found) * factor), remedy(factor))
        });
        let text = format!(
            "the median depth is {} m, expected {} to {} m in a room: check the unit of the depth{remedy}",
            if found < 0.01 { rounded(f64::from(found)) } else { format!("{found:.2}") },
            USUAL_DEPTH.start(),
            USUAL_DEPTH.end()
        );
        Some(InputDoubt { kind: DoubtKind::DepthUnit, text })
    }

    /// True if a unit of depth has been doubted.
    pub(super) fn is_told(&self) -> bool {
        self.is_told
    }

    /// Keeps silent about a unit of depth that has been doubted already.
    pub(super) fn set_told(&mut self) {
        self.is_told = true;
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use splatseg_geometry::{Image, Intrinsics};

    const CAMERA: Intrinsics = Intrinsics { fx: 250.0, fy: 250.0, cx: 15.5, cy: 11.5, width: 32, height: 24 };

    fn doubt(depth: f32) -> Option<String> {
        let (color, depth) = (Image::filled(32, 24, [9; 3]), Image::filled(32, 24, depth));
        let frame = CameraFrame::new("frame", color, depth, CAMERA).unwrap();
        let mut usual = UsualDepth::default();
        let doubts: Vec<InputDoubt> = (0..2 * DEPTH_FRAMES).filter_map(|_| usual.add(&frame)).collect();
        assert!(doubts.len() < 2 && usual.doubt().is_none(), "told once: {doubts:?}");
        doubts.into_iter().next().map(|doubt| doubt.text)
    }

    #[test]
    fn depth_in_a_wrong_unit_is_doubted_and_a_likely_one_is_named() {
        assert_eq!((doubt(0.0), doubt(2.0), doubt(0.4)), (None, None, None));
        let metres = doubt(2000.0).unwrap();
        assert!(metres.starts_with("the median depth is 2000.00 m, expected 0.3 to 15 m in a room: check the unit"));
        assert!(metres.contains("would be 2 m") && metres.contains("to 1000 times its value"), "{metres}");
        assert!(doubt(20.0).unwrap().contains("5 times its value, e.g. 5000 instead of 1000"), "{:?}", doubt(20.0));
        let small = doubt(0.002).unwrap();
        assert!(small.contains("0.002 m, ") && small.contains("e.g. 1 instead of 1000"), "{small}");
        assert!(doubt(1e30).unwrap().ends_with("check the unit of the depth"), "{:?}", doubt(1e30));
    }

    #[test]
    fn factors_are_those_of_mistaken_units() {
        assert_eq!(mistaken_unit(5.3), Some((1000.0, 5000.0)));
        assert_eq!(mistaken_unit(0.19), Some((5000.0, 1000.0)));
        assert_eq!(mistaken_unit(2.3), None);
        assert_eq!([rounded(0.2), rounded(1234.6), rounded(0.15259), rounded(2.0)], ["0.2", "1235", "0.153", "2"]);
    }

    #[test]
    fn few_frames_are_judged_at_the_end() {
        let (color, depth) = (Image::filled(32, 24, [9; 3]), Image::filled(32, 24, 0.2));
        let mut usual = UsualDepth::default();
        assert!(usual.add(&CameraFrame::new("frame", color, depth, CAMERA).unwrap()).is_none());
        assert!(usual.doubt().unwrap().text.contains("the median depth is 0.20 m"));
    }
}
