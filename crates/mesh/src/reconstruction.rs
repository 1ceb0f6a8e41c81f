//! Map and keyframes in, mesh out.

use crate::block_grid::{BLOCK_BYTES, BlockGrid, blocks_near_surfaces};
use crate::cleaning::{cleaned, smoothed_ids};
use crate::depth_planes::depth_planes;
use crate::fusion::{DepthView, add_view};
use crate::surface_nets::surface;
use crate::triangle_mesh::TriangleMesh;
use crate::vertex_colors::vertex_colors;
use glam::{DVec3, IVec3, Vec3};
use splatseg_files::{MemoryLimit, display_bytes};
use splatseg_geometry::{MapGaussian, MapView, SegmentId};
use splatseg_objects::{VertexId, vertex_ids};
use splatseg_odometry::KeyframeView;
use std::ops::RangeInclusive;
use thiserror::Error;

/// The finest voxel that is chosen, metres: pixels of keyframes are that wide at a distance of 2 m.
const FINEST: f32 = 0.015;
/// A voxel that is chosen is larger than the one before by this factor, until it fits.
const COARSER: f32 = 1.26;
/// The field takes at most this share of the memory limit...
const SHARE: u64 = 4;
/// ...and, if the voxels are chosen, no more than this.
const MAX_CHOSEN_BYTES: u64 = 1 << 30;
/// Rounds of [`smoothed_ids`].
const ID_ROUNDS: usize = 2;

/// Settings of a mesh.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct MeshSettings {
    /// Side of a voxel, metres. By default 1.5 cm, or the finest that fits into the memory limit.
    pub voxel: Option<f32>,
}

/// Why there is no mesh.
#[derive(Clone, Debug, Error, PartialEq)]
#[non_exhaustive]
pub enum MeshError {
    /// The size of voxels is not in [`MeshSettings::VOXEL`].
    #[error("voxel: found {found}, expected {} to {} metres", MeshSettings::VOXEL.start(), MeshSettings::VOXEL.end())]
    Voxel {
        /// The size.
        found: f32,
    },
    /// The voxels would take too much memory.
    #[error("voxels of {voxel} m take {needed}, but a quarter of the memory limit is {limit}: choose larger ones")]
    MemoryLimit {
        /// Their size, metres.
        voxel: f32,
        /// Memory that they need, bytes.
        needed: String,
        /// Memory that they may take, bytes.
        limit: String,
    },
    /// No keyframe has depth.
    #[error("its keyframes have no depth, so it has no surfaces")]
    NoDepth,
    /// No surface of the keyframes is in the map.
    #[error("its keyframes show no surface that the map holds")]
    NoSurface,
}

impl MeshSettings {
    /// Allowed sizes of voxels, metres.
    pub const VOXEL: RangeInclusive<f32> = 0.002..=0.5;

    /// Checks the settings.
    ///
    /// # Errors
    /// [`MeshError::Voxel`] if a size is not allowed.
    pub fn validate(&self) -> Result<(), MeshError> {
        match self.voxel {
            Some(found) if !Self::VOXEL.contains(&found) => Err(MeshError::Voxel { found }),
            _ => Ok(()),
        }
    }
}

/// Makes a mesh of the surfaces that the keyframes of a map show and the map still holds. The same map gives the same mesh,
/// whatever the number of threads.
///
/// # Errors
/// If a setting is not allowed, the voxels do not fit into the memory limit, or there is no surface.
pub fn reconstruct(
    map: &MapView<'_>,
    keyframes: &[KeyframeView],
    settings: &MeshSettings,
) -> Result<TriangleMesh, MeshError> {
    settings.validate()?;
    let views = DepthView::of(keyframes, map.origin);
    let mut grid = chosen_grid(&views, settings)?;
    for view in &views {
        add_view(&mut grid, view, &depth_planes(view.depth, &view.intrinsics));
    }
    let found = surface(&grid);
    drop(grid);
    let around = vertex_ids(&gaussians_with_place(map), &found.positions);
    let triangles = cleaned(found.triangles, &around);
    if triangles.is_empty() {
        return Err(MeshError::NoSurface);
    }
    Ok(described(&views, keyframes, map.origin, (&found.positions, &triangles, &around)))
}

/// The Gaussians whose place means something.
fn gaussians_with_place(map: &MapView<'_>) -> Vec<MapGaussian> {
    let all = map.gaussians().into_iter().zip(map.surfaces);
    all.filter(|(_, surface)| surface.has_place()).map(|(gaussian, _)| gaussian).collect()
}

/// The blocks near surfaces, with voxels of the given size or the finest that fits.
fn chosen_grid(views: &[DepthView], settings: &MeshSettings) -> Result<BlockGrid, MeshError> {
    let limit = MemoryLimit::in_force() / SHARE;
    let blocks = |voxel: f32| -> Result<Vec<IVec3>, MeshError> {
        let places = blocks_near_surfaces(views, |view| depth_planes(view.depth, &view.intrinsics), voxel);
        if places.is_empty() { Err(MeshError::NoDepth) } else { Ok(places) }
    };
    let bytes = |places: &[IVec3]| BLOCK_BYTES * places.len() as u64;
    if let Some(voxel) = settings.voxel {
        let places = blocks(voxel)?;
        if bytes(&places) > limit {
            let (needed, limit) = (display_bytes(bytes(&places)), display_bytes(limit));
            return Err(MeshError::MemoryLimit { voxel, needed, limit });
        }
        return Ok(BlockGrid::new(voxel, places));
    }
    let mut voxel = FINEST;
    loop {
        let places = blocks(voxel)?;
        if bytes(&places) <= limit.min(MAX_CHOSEN_BYTES) || voxel * COARSER > *MeshSettings::VOXEL.end() {
            return Ok(BlockGrid::new(voxel, places));
        }
        voxel *= COARSER;
    }
}

/// The triangles with the colours and ids of their vertices.
fn described(
    views: &[DepthView],
    keyframes: &[KeyframeView],
    origin: DVec3,
    (positions, triangles, around): (&[Vec3], &[[u32; 3]], &[VertexId]),
) -> TriangleMesh {
    let ids: Vec<SegmentId> = around.iter().map(|found| found.id).collect();
    let ids = smoothed_ids(triangles, ids, ID_ROUNDS);
    let own: Vec<[u8; 3]> = around.iter().map(|found| found.color.unwrap_or_default()).collect();
    let whole = TriangleMesh { origin, positions: positions.to_vec(), colors: own, ids, triangles: Vec::new() };
    let mut mesh = whole.part(triangles);
    let seen = vertex_colors(&mesh.positions, views, keyframes);
    // What no colour image shows has the colour of the map.
    let both = mesh.colors.iter_mut().zip(seen);
    both.for_each(|(color, seen)| *color = seen.unwrap_or(*color));
    mesh
}
