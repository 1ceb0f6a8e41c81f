//! Export of a memory's Gaussians to PLY files with only the data that other programs show.

use super::header::origin_comment;
use super::record::{LOGIT_OF_1, harmonic};
use super::{SplatContentView, SplatFile, SplatFileError};
use crate::map::SplatMap;
use crate::saved_state::saved_surfaces;
use glam::DVec3;
use splatseg_geometry::{MapGaussian, SegmentId, SurfaceKind};
use std::io::{self, Write};

/// Properties written for each Gaussian.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ExportedForm {
    /// The properties of 3D Gaussian splatting in their usual order, spherical harmonics of degree 0, then
    /// `segment_id`.
    Gaussians,
    /// `x y z red green blue segment_id`: a point cloud.
    Points,
}

impl ExportedForm {
    fn properties(self) -> &'static [&'static str] {
        match self {
            Self::Gaussians => &[
                "float x",
                "float y",
                "float z",
                "float nx",
                "float ny",
                "float nz",
                "float f_dc_0",
                "float f_dc_1",
                "float f_dc_2",
                "float opacity",
                "float scale_0",
                "float scale_1",
                "float scale_2",
                "float rot_0",
                "float rot_1",
                "float rot_2",
                "float rot_3",
                "int segment_id",
            ],
            Self::Points => {
                &["float x", "float y", "float z", "uchar red", "uchar green", "uchar blue", "int segment_id"]
            }
        }
    }

    /// True if positions are written as `double`: far from the world's origin `float` has too few digits, and readers
    /// of point clouds accept `double`.
    fn is_double(self, origin: DVec3) -> bool {
        self == Self::Points && origin != DVec3::ZERO
    }

    /// Appends the vertex of a Gaussian, little-endian.
    fn encode(self, gaussian: &MapGaussian, origin: DVec3, bytes: &mut Vec<u8>) {
        if self.is_double(origin) {
            let mean = gaussian.mean.as_dvec3() + origin;
            bytes.extend(mean.to_array().into_iter().flat_map(f64::to_le_bytes));
        } else {
            bytes.extend(gaussian.mean.to_array().into_iter().flat_map(f32::to_le_bytes));
        }
        match self {
            Self::Gaussians => {
                let [red, green, blue] = gaussian.color.map(harmonic);
                let scale = f64::from(gaussian.radius).ln() as f32;
                let floats = [0.0, 0.0, 0.0, red, green, blue, LOGIT_OF_1, scale, scale, scale, 1.0, 0.0, 0.0, 0.0];
                bytes.extend(floats.into_iter().flat_map(f32::to_le_bytes));
            }
            Self::Points => bytes.extend(gaussian.color),
        }
        bytes.extend(gaussian.segment_id.to_le_bytes());
    }
}

impl SplatFile {
    /// Iterates over all Gaussians, in the order of the file.
    pub fn gaussians(&self) -> impl Iterator<Item = MapGaussian> + '_ {
        gaussians(&self.map, &self.segment_ids, self.content.view())
    }

    /// Returns whether the surface of each Gaussian was observed or completed, in the order of the file. In a file of an earlier version all
    /// were observed.
    ///
    /// # Errors
    /// If the array in `saved_state` that contains it is damaged.
    pub fn surfaces(&self) -> Result<Vec<SurfaceKind>, SplatFileError> {
        saved_surfaces(&self.saved_state, self.map.len()).map_err(|found| SplatFileError::DamagedSavedState { found })
    }
}

fn gaussians<'a>(
    map: &'a SplatMap,
    segment_ids: &'a [SegmentId],
    content: SplatContentView<'a>,
) -> impl Iterator<Item = MapGaussian> + 'a {
    let balls = map.balls.means.iter().zip(&map.balls.radii).zip(&map.colors);
    balls.zip(segment_ids).enumerate().map(move |(index, (((mean, radius), color), id))| MapGaussian {
        mean: *mean,
        radius: *radius,
        color: *color,
        segment_id: *id,
        confidence: content.confidence(index, *id),
    })
}

impl SplatContentView<'_> {
    /// Confidence of the segment `id` of a Gaussian, see [`MapGaussian::confidence`].
    pub(crate) fn confidence(&self, index: usize, id: SegmentId) -> f32 {
        match self {
            Self::Evidence { votes } => {
                let votes = votes.get(index).copied().unwrap_or_default();
                let (all, own) = votes.iter().fold((0.0, 0.0), |(all, own), (voted, votes)| {
                    (all + votes, if voted == id { own + votes } else { own })
                });
                own / f32::max(all, 1.0)
            }
            Self::Features { features, codebook } => {
                let dim = codebook.feature_dim();
                match features.get(index * dim..(index + 1) * dim).unwrap_or_default() {
                    // An id, not a direction.
                    [_] => f32::from(u8::from(id != 0)),
                    feature => feature.iter().map(|value| value * value).sum::<f32>().sqrt().min(1.0),
                }
            }
            Self::Arrays { .. } => f32::from(u8::from(id != 0)),
        }
    }
}

/// Writes Gaussians as a binary little-endian PLY file. Their coordinates are relative to `origin` (world coordinates,
/// metres). If the origin is not zero, [`ExportedForm::Points`] are written in world coordinates as `double`, and
/// [`ExportedForm::Gaussians`] with a comment that states the origin.
///
/// # Errors
/// If `output` cannot be written.
pub fn write_exported(
    form: ExportedForm,
    origin: DVec3,
    gaussians: &[MapGaussian],
    output: &mut impl Write,
) -> io::Result<()> {
    let (count, is_double) = (gaussians.len(), form.is_double(origin));
    write!(output, "ply\nformat binary_little_endian 1.0\ncomment exported by splatseg\n")?;
    if !is_double {
        output.write_all(origin_comment(origin).as_bytes())?;
    }
    writeln!(output, "element vertex {count}")?;
    for property in form.properties() {
        let is_position = is_double && ["float x", "float y", "float z"].contains(property);
        let property = if is_position { property.replace("float", "double") } else { (*property).to_owned() };
        writeln!(output, "property {property}")?;
    }
    writeln!(output, "end_header")?;
    let mut vertex = Vec::new();
    for gaussian in gaussians {
        vertex.clear();
        form.encode(gaussian, origin, &mut vertex);
        output.write_all(&vertex)?;
    }
    Ok(())
}
