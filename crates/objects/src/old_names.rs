//! Names of objects in maps of version 4, which are text: JSON, with embeddings in Base64. They are only read.

use crate::names::{NameError, ObjectName, SavedName};
use base64::Engine;
use base64::engine::general_purpose::STANDARD as BASE64;
use serde::Deserialize;
use splatseg_geometry::SegmentId;

#[derive(Deserialize)]
struct OldName {
    id: SegmentId,
    #[serde(default)]
    label: Option<String>,
    /// Little-endian `f32`s in Base64.
    #[serde(default)]
    embedding: String,
    score: f64,
}

/// The names from the text of a map.
///
/// # Errors
/// [`NameError::Damaged`] if the text is not in the form of that version.
pub(crate) fn converted(text: &[u8]) -> Result<Vec<SavedName>, NameError> {
    let names: Vec<OldName> = serde_json::from_slice(text).map_err(|error| NameError::Damaged(error.to_string()))?;
    let name = |OldName { id, label, embedding, score }: OldName| {
        let wrong = |problem: &str| NameError::Damaged(format!("object {id} {problem}"));
        let numbers = BASE64.decode(embedding).map_err(|_| wrong("has an embedding that is not Base64"))?;
        let (numbers, rest) = numbers.as_chunks();
        if !rest.is_empty() {
            return Err(wrong("has half a number in its embedding"));
        }
        Ok(SavedName {
            id,
            name: ObjectName {
                label,
                embedding: numbers.iter().map(|number| f32::from_le_bytes(*number)).collect(),
                ..ObjectName::default()
            },
            score,
        })
    };
    names.into_iter().map(name).collect()
}
