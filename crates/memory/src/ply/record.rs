//! Conversion between a Gaussian and the bytes of a PLY vertex.

use super::error::SplatFileError;
use super::layout::{FLOAT_PROPERTIES, Layout, Sizes};
use super::{SplatContentView, SplatFileView};
use crate::{SplatMap, Votes};
use glam::Vec3;
use splatseg_geometry::SegmentId;
use splatseg_render::Balls;
use std::path::Path;

/// Y_00, the spherical harmonic of degree 0: 1 / (2 √π).
const HARMONIC_0: f64 = 0.28209479177387814;
/// Logit of opacity 1: its sigmoid is 1 in `f32`.
pub const LOGIT_OF_1: f32 = 20.0;

/// Appends the record of Gaussian `index`.
pub fn encode(view: &SplatFileView<'_>, index: usize, path: &Path, bytes: &mut Vec<u8>) -> Result<(), SplatFileError> {
    let vertex = Vertex { path, index };
    let (mean, radius) = (view.map.balls.means[index], view.map.balls.radii[index]);
    for (value, property) in mean.to_array().into_iter().zip(FLOAT_PROPERTIES) {
        vertex.finite(property, value)?;
    }
    vertex.positive("radius", radius)?;
    vertex.at_most("last_seen", view.map.last_seen[index], view.frames)?;
    vertex.known("segment_id", view.segment_ids[index], view.ids)?;
    let [red, green, blue] = view.map.colors[index].map(harmonic);
    let scale = f64::from(radius).ln() as f32;
    let shape = [LOGIT_OF_1, scale, scale, scale, 1.0, 0.0, 0.0, 0.0, radius];
    let floats = [mean.x, mean.y, mean.z, 0.0, 0.0, 0.0, red, green, blue].into_iter().chain(shape);
    bytes.extend(floats.flat_map(f32::to_le_bytes));
    bytes.extend(view.map.last_seen[index].to_le_bytes());
    bytes.extend(u32::from(view.map.seen_through[index]).to_le_bytes());
    match &view.content {
        SplatContentView::Evidence { votes } => {
            for (slot, (id, votes)) in votes[index].slots().into_iter().enumerate() {
                vertex.not_negative(format_args!("votes_{slot}"), votes)?;
                if votes > 0.0 {
                    vertex.known(format_args!("vote_id_{slot}"), id, view.ids)?;
                }
                bytes.extend(id.to_le_bytes());
                bytes.extend(votes.to_le_bytes());
            }
        }
        SplatContentView::Features { features, codebook } => {
            let dim = codebook.feature_dim();
            for (channel, value) in features[index * dim..(index + 1) * dim].iter().enumerate() {
                vertex.finite(format_args!("feature_{channel}"), *value)?;
                bytes.extend(value.to_le_bytes());
            }
        }
        SplatContentView::Arrays { .. } => {}
    }
    bytes.extend(view.segment_ids[index].to_le_bytes());
    Ok(())
}

/// The Gaussians of a file.
pub struct Records {
    /// The map, N entries.
    pub map: SplatMap,
    /// `[N]`; empty in a file of other content.
    pub votes: Vec<Votes>,
    /// Row-major `[N, D]`; empty in a file of other content.
    pub features: Vec<f32>,
    /// `[N]`.
    pub segment_ids: Vec<u32>,
}

impl Records {
    /// Creates empty records with room for the Gaussians of a file. The length of the file must have been checked.
    pub fn with_capacity(sizes: &Sizes) -> Self {
        let count = sizes.gaussians as usize;
        let (votes, features) = match sizes.layout {
            Layout::Evidence => (count, 0),
            Layout::Features { feature_dim, .. } => (0, count * feature_dim),
            Layout::Arrays => (0, 0),
        };
        let map = SplatMap {
            balls: Balls { means: Vec::with_capacity(count), radii: Vec::with_capacity(count) },
            colors: Vec::with_capacity(count),
            last_seen: Vec::with_capacity(count),
            seen_through: Vec::with_capacity(count),
            anchors: Vec::new(),
            surfaces: Vec::new(),
        };
        let (votes, features) = (Vec::with_capacity(votes), Vec::with_capacity(features));
        Self { map, votes, features, segment_ids: Vec::with_capacity(count) }
    }
}

/// Appends the Gaussian of one record.
pub fn decode(record: &[u8], sizes: &Sizes, records: &mut Records, path: &Path) -> Result<(), SplatFileError> {
    let vertex = Vertex { path, index: records.map.len() };
    let (words, _) = record.as_chunks::<4>();
    // A record has the length of its layout, so these else branches are unreachable.
    let Some((floats, rest)) = words.split_first_chunk::<{ FLOAT_PROPERTIES.len() }>() else { return Ok(()) };
    let Some(([last_seen, seen_through], rest)) = rest.split_first_chunk() else { return Ok(()) };
    let Some((segment_id, content)) = rest.split_last() else { return Ok(()) };

    let floats = floats.map(f32::from_le_bytes);
    for (value, property) in floats.into_iter().zip(FLOAT_PROPERTIES) {
        vertex.finite(property, value)?;
    }
    let [x, y, z, _, _, _, red, green, blue, .., radius] = floats;
    vertex.positive("radius", radius)?;
    let seen_through = u32::from_le_bytes(*seen_through);
    vertex.at_most("seen_through", seen_through, u32::from(u8::MAX))?;
    let segment_id = u32::from_le_bytes(*segment_id);
    match sizes.layout {
        Layout::Evidence => records.votes.push(decode_votes(content, &vertex)?),
        Layout::Features { .. } => {
            for (channel, value) in content.iter().map(|&bytes| f32::from_le_bytes(bytes)).enumerate() {
                vertex.finite(format_args!("feature_{channel}"), value)?;
                records.features.push(value);
            }
        }
        Layout::Arrays => {}
    }
    records.map.balls.push(Vec3::new(x, y, z), radius);
    records.map.colors.push([red, green, blue].map(color));
    records.map.last_seen.push(u32::from_le_bytes(*last_seen));
    records.map.seen_through.push(seen_through as u8);
    records.segment_ids.push(segment_id);
    Ok(())
}

fn decode_votes(words: &[[u8; 4]], vertex: &Vertex<'_>) -> Result<Votes, SplatFileError> {
    let mut slots = [(0, 0.0); Votes::SLOTS];
    for (slot, (into, [id, votes])) in slots.iter_mut().zip(words.as_chunks().0).enumerate() {
        let (id, votes) = (u32::from_le_bytes(*id), f32::from_le_bytes(*votes));
        vertex.not_negative(format_args!("votes_{slot}"), votes)?;
        *into = (id, votes);
    }
    Ok(Votes::from_slots(slots))
}

/// Returns an error if a frame number exceeds the number of frames learnt.
pub fn check_last_seen(last_seen: &[u32], frames: u32, path: &Path) -> Result<(), SplatFileError> {
    let mut numbers = last_seen.iter().enumerate();
    numbers.try_for_each(|(index, &frame)| Vertex { path, index }.at_most("last_seen", frame, frames))
}

/// Refuses Gaussians that show or have votes for an id that the file does not list.
pub fn check_ids(
    segment_ids: &[SegmentId],
    votes: &[Votes],
    ids: &[SegmentId],
    path: &Path,
) -> Result<(), SplatFileError> {
    for (index, id) in segment_ids.iter().enumerate() {
        Vertex { path, index }.known("segment_id", *id, ids)?;
    }
    for (index, votes) in votes.iter().enumerate() {
        for (slot, (id, _)) in votes.slots().into_iter().enumerate().filter(|(_, (_, votes))| *votes > 0.0) {
            Vertex { path, index }.known(format_args!("vote_id_{slot}"), id, ids)?;
        }
    }
    Ok(())
}

/// A Gaussian in a file, for checking its values.
struct Vertex<'a> {
    path: &'a Path,
    index: usize,
}

impl Vertex<'_> {
    fn check(
        &self,
        holds: bool,
        property: impl std::fmt::Display,
        found: impl std::fmt::Display,
        expected: impl std::fmt::Display,
    ) -> Result<(), SplatFileError> {
        if holds {
            return Ok(());
        }
        Err(SplatFileError::Value {
            path: self.path.to_owned(),
            gaussian: self.index,
            property: property.to_string(),
            found: found.to_string(),
            expected: expected.to_string(),
        })
    }

    fn finite(&self, property: impl std::fmt::Display, value: f32) -> Result<(), SplatFileError> {
        self.check(value.is_finite(), property, value, "a finite value")
    }

    fn positive(&self, property: impl std::fmt::Display, value: f32) -> Result<(), SplatFileError> {
        self.check(value.is_finite() && value > 0.0, property, value, "a positive finite value")
    }

    fn not_negative(&self, property: impl std::fmt::Display, value: f32) -> Result<(), SplatFileError> {
        self.check(value.is_finite() && value >= 0.0, property, value, "a finite value that is not negative")
    }

    /// Requires 0 or one of the `ids`, which are sorted.
    fn known(&self, property: impl std::fmt::Display, id: SegmentId, ids: &[SegmentId]) -> Result<(), SplatFileError> {
        let is_known = id == 0 || ids.binary_search(&id).is_ok();
        self.check(is_known, property, id, format_args!("0 or one of the {} ids of the file", ids.len()))
    }

    fn at_most(&self, property: impl std::fmt::Display, value: u32, max: u32) -> Result<(), SplatFileError> {
        self.check(value <= max, property, value, format_args!("a number from 0 to {max}"))
    }
}

/// Returns the coefficient that 3D Gaussian splatting stores for a channel, sRGB.
pub fn harmonic(channel: u8) -> f32 {
    ((f64::from(channel) / 255.0 - 0.5) / HARMONIC_0) as f32
}

fn color(harmonic: f32) -> u8 {
    // Casts saturate, so values are clamped as in viewers.
    ((f64::from(harmonic) * HARMONIC_0 + 0.5) * 255.0).round() as u8
}
