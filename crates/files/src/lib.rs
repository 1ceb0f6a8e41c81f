//! Files: untrusted ones are read with limits, results are written whole or not at all.
//!
//! Every file of a scene, a checkpoint or a folder of masks is opened with [`open_file`] or [`read_file`]. They accept
//! only regular files, so that no FIFO blocks the program and no device is read forever. The sizes stated in a file are
//! checked against the [`MemoryLimit`] before memory is allocated.
//!
//! [`text_of`] reads text as other systems write it, with a byte order mark or as UTF-16; [`csv_cell`] writes it for
//! spreadsheets.
//!
//! A [`StateBlock`] holds what is saved to be continued later: named arrays, in the form of a safetensors file.
//!
//! An [`AtomicFile`] is written under a temporary name in the folder of its destination and renamed when it is
//! complete and on the disk. A reader sees the old file or the new one, never a partial file, also after a power cut. If
//! anything fails, or the file is dropped before it is committed, the temporary file is removed and the old file stays.

mod atomic_file;
mod memory_limit;
mod regular_file;
mod state_block;
mod text;

pub use atomic_file::{AtomicFile, remove_leftovers, sync_file_system, write_atomically, write_unsynced};
pub use memory_limit::{ByteSizeTextError, MemoryLimit, address_space_limit, display_bytes};
pub use regular_file::{open_file, read_file};
pub use state_block::{StateBlock, StateError, StateNumber};
pub use text::{TextError, csv_cell, has_decimal_commas, is_number_with_comma, text_of, utf8_bytes, without_mark};
