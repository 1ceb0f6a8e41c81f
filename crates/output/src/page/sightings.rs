//! The frames that show an object.

use splatseg_objects::ObjectSighting;

/// Sightings of an object. Frames are given by their index.
#[derive(Debug, Default)]
pub struct Sightings {
    /// First and last frame of each uninterrupted stretch.
    pub stretches: Vec<(usize, usize)>,
    /// The largest area, pixels, and the index of its frame.
    pub largest: (usize, usize),
    /// Sum of its confidence over the sightings.
    confidence: f64,
    /// Number of sightings: the frames that show it, twice if a frame showed two ids that later turned out to be it.
    sightings: usize,
}

impl Sightings {
    /// Adds the next frame that shows it.
    pub fn add(&mut self, frame: usize, sighting: &ObjectSighting) {
        self.sightings += 1;
        self.confidence += f64::from(sighting.confidence);
        self.largest = larger(self.largest, (sighting.area, frame));
        match self.stretches.last_mut() {
            Some((_, last)) if *last + 1 == frame => *last = frame,
            _ => self.stretches.push((frame, frame)),
        }
    }

    /// Adds the sightings of another id that turned out to be this object.
    pub fn merge(&mut self, other: Self) {
        let mut all = std::mem::take(&mut self.stretches);
        all.extend(other.stretches);
        all.sort_unstable();
        for (first, last) in all {
            match self.stretches.last_mut() {
                Some((_, before)) if first <= *before + 1 => *before = last.max(*before),
                _ => self.stretches.push((first, last)),
            }
        }
        self.largest = larger(self.largest, other.largest);
        self.confidence += other.confidence;
        self.sightings += other.sightings;
    }

    /// Number of frames that show it.
    pub fn frames(&self) -> usize {
        self.stretches.iter().map(|(first, last)| last + 1 - first).sum()
    }

    /// Mean confidence of its sightings.
    pub fn mean_confidence(&self) -> f32 {
        (self.confidence / self.sightings.max(1) as f64) as f32
    }
}

/// The larger of two areas with their frames; of equal ones, the earlier frame.
pub fn larger(one: (usize, usize), other: (usize, usize)) -> (usize, usize) {
    match (other.0 > one.0, other.0 == one.0) {
        (true, _) => other,
        (false, true) => (one.0, one.1.min(other.1)),
        (false, false) => one,
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use splatseg_objects::BoundingBox;

    #[test]
    fn frames_that_show_both_parts_count_once() {
        let bounding_box = BoundingBox { x: 0, y: 0, width: 1, height: 1 };
        let part = |frames: &[usize], area, confidence| {
            let mut part = Sightings::default();
            for frame in frames {
                let sighting = ObjectSighting {
                    id: 1,
                    area,
                    bounding_box,
                    confidence,
                    first_frame: frames[0],
                    last_frame: *frame,
                };
                part.add(*frame, &sighting);
            }
            part
        };
        let mut object = part(&[0, 1, 2, 6, 7], 10, 1.0);
        object.merge(part(&[2, 3, 4, 9], 20, 0.1));
        assert_eq!(object.stretches, [(0, 4), (6, 7), (9, 9)]);
        assert_eq!((object.frames(), object.largest), (8, (20, 2)));
        assert!((object.mean_confidence() - 0.6).abs() < 1e-6);
    }
}
