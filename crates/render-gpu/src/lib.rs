//! The map of a memory on a GPU: projection, tiles, blending, evidence or features, growth and removal.
//!
//! [`GpuDevice`] opens a Vulkan device; `splatseg_memory::SplatMemory::on_device` moves a memory there. The Gaussians stay on
//! the device. Per frame, its depth, colour and predictions go up, and images of what is expected and shown come down; blend weights
//! are made and used on the device only. Rules and the order of sums are those of `splatseg-render` and `splatseg-memory`, so
//! results agree with theirs but for roundings. No sum depends on the order of threads.
//!
//! | file | what it does |
//! | --- | --- |
//! | `device.rs` | opens a device; buffers; counts transfers |
//! | `gaussians.rs` | the Gaussians on the device: appended, removed, read to be saved |
//! | `view.rs` | a view: sights, projection, tiles, blending, expected segments |
//! | `gpu_map.rs` | what a memory asks for: recall, fuse, update |
//! | `store.rs` | what Gaussians remember of segments: the one thing in which the kinds of memory differ |
//! | `evidence.rs` | votes |
//! | `features.rs` | features: rendered, decoded, written for new Gaussians |
//! | `descent.rs` | gradient descent on features |
//! | `growth.rs` | new Gaussians where a frame shows what the map lacks |
//! | `sorting.rs` | prefix sums and the radix sort |
//! | `kernels/` | the kernels, a file for each counterpart on the CPU |
//! | `error.rs` | what can go wrong |

mod descent;
mod device;
mod error;
mod evidence;
mod features;
mod gaussians;
mod gpu_map;
mod growth;
mod kernels;
mod sorting;
mod store;
mod view;

pub use device::{GpuDevice, Transfers};
pub use error::GpuError;

#[cfg(doctest)]
#[doc = include_str!("../README.md")]
struct Readme;

#[cfg(test)]
mod tests;
