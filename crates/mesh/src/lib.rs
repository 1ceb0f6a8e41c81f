//! A triangle mesh of a saved map, from the depth of its keyframes.
//!
//! Depth images are combined in a truncated signed distance field (Curless and Levoy, "A volumetric method for building
//! complex models from range images", 1996), of which only the blocks near surfaces are kept. Its zero surface is found
//! with surface nets (Gibson, "Constrained elastic surface nets", 1998). What the map does not hold any more, such as
//! things that were taken away, is left out: a surface needs a Gaussian near it.
//!
//! | file | |
//! | --- | --- |
//! | `reconstruction.rs` | map and keyframes in, mesh out |
//! | `depth_planes.rs` | a depth image with the plane, the noise and the edges at each pixel |
//! | `block_grid.rs` | which blocks of voxels are kept, and how large voxels are |
//! | `fusion.rs` | adds depth images to the field |
//! | `surface_nets.rs` | the surface of the field |
//! | `vertex_colors.rs` | the colour of each vertex, from the keyframes' images |
//! | `cleaning.rs` | takes away triangles without a Gaussian near them, and specks |
//! | `triangle_mesh.rs` | the mesh, and the part of an object |
//! | `ply_file.rs`, `gltf_file.rs` | its files |

mod block_grid;
mod cleaning;
mod depth_planes;
mod fusion;
mod gltf_file;
mod ply_file;
mod reconstruction;
mod surface_nets;
mod triangle_mesh;
mod vertex_colors;

pub use gltf_file::{GltfObject, write_glb};
pub use ply_file::write_ply;
pub use reconstruction::{MeshError, MeshSettings, reconstruct};
pub use triangle_mesh::TriangleMesh;

#[cfg(doctest)]
#[doc = include_str!("../README.md")]
struct Readme;
