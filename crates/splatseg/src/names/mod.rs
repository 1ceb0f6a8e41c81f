//! Names of objects from a network for images and words, and objects found by words.
//!
//! | file | content |
//! | --- | --- |
//! | `vocabulary.rs` | the labels to choose from, with other words for each |
//! | `crops.rs` | what the network sees of a view |
//! | `label_choice.rs` | from similarities to labels: scores standardised over the objects of a map |
//! | `clip_names.rs` | the network with its vocabulary |
//! | `namer.rs` | the network as a namer: `clip` of the settings |
//! | `keyframe_crops.rs` | views of the objects of a saved map, from its keyframes |
//! | `find.rs`, `query.rs` | objects found by label, picture, colour and size |
//!
//! `docs/NAMES.md` explains them to users.

mod clip_names;
mod crops;
mod find;
mod keyframe_crops;
mod label_choice;
mod namer;
mod query;
mod vocabulary;

pub use clip_names::{ClipNames, NamesError};
pub use find::{FoundObject, find_objects};
pub use keyframe_crops::{segments_of_keyframe, views_from_keyframes};
pub use namer::ClipNamerSettings;
pub use query::{Query, color_word};
pub use vocabulary::{Vocabulary, VocabularyError};
