//! The integration tests of this crate, in one program: it is linked once.

mod corrected_rooms;
mod failing_segmenter;
mod late_results;
mod lost_camera;
mod mesh_accuracy;
mod mesh_of_map;
mod method_preset;
mod names;
mod predicted_depth;
mod registered_parts;
mod rooms_named;
mod tiny_clip;
mod turned_frames;
mod views_by_surface;
mod words;
mod working_pixels;
