//! Names of objects: a label and an embedding each.
//!
//! They are saved with a map as arrays whose names begin with `names`:
//!
//! | Array | Type | |
//! |---|---|---|
//! | `id` | `u32 [n]` | the named objects, in increasing order |
//! | `score` | `f64 [n]` | of the view from which each was named |
//! | `labels.json` | text | a list of `n` texts, `null` for none |
//! | `details.json` | text | a list of `n` objects with what else is known of a label (score, alternatives, `by_hand`), or `null` |
//! | `embedding_id` | `u32 [m]` | the objects that have an embedding, in the same order |
//! | `embedding` | `f32 [m, d]` | their embeddings |
//! | `rooms.json` | text | the names of rooms: a list of `place` and `name`; missing without any |

use crate::old_names;
use crate::room_names::{RoomName, RoomNames};
use serde::{Deserialize, Serialize};
use splatseg_files::{StateBlock, StateError};
use splatseg_geometry::{RemappedId, SegmentId};
use std::collections::{BTreeMap, BTreeSet};
use thiserror::Error;

/// Maximum length of a label, bytes.
const MAX_LABEL_BYTES: usize = 1000;
/// Maximum number of alternatives of a label that are kept.
const MAX_ALTERNATIVES: usize = 8;
/// Maximum size of all labels and embeddings together, bytes.
const MAX_BYTES: usize = 1 << 25;

/// An object's name.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct ObjectName {
    /// A word or a few, e.g. `mug`.
    pub label: Option<String>,
    /// The object as a vector, e.g. CLIP's embedding of its image; may be empty. All others have one length.
    pub embedding: Vec<f32>,
    /// How clearly the label fits, if that is known: larger is clearer. Each namer says in which unit.
    pub score: Option<f32>,
    /// Other labels that fit, best first.
    pub alternatives: Vec<LabelScore>,
    /// A person gave the label, so no namer replaces it.
    pub by_hand: bool,
}

/// A label and how clearly it fits.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct LabelScore {
    /// The label.
    pub label: String,
    /// As [`ObjectName::score`].
    pub score: f32,
}

/// Details of a label besides its text, in a file.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
struct LabelDetails {
    #[serde(default, skip_serializing_if = "Option::is_none")]
    score: Option<f32>,
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    alternatives: Vec<LabelScore>,
    #[serde(default, skip_serializing_if = "std::ops::Not::not")]
    by_hand: bool,
}

/// An unusable name or embedding.
#[derive(Clone, Debug, PartialEq, Eq, Error)]
#[non_exhaustive]
pub enum NameError {
    /// The embedding has another length than those of other objects.
    #[error("the embedding has {found} numbers, but those of the named objects have {expected}")]
    Length {
        /// Its length.
        found: usize,
        /// Length of the others.
        expected: usize,
    },
    /// A number of the embedding is NaN or infinite.
    #[error("the embedding's number {index} is {found}, expected a finite number")]
    NotFinite {
        /// Its position, from 0.
        index: usize,
        /// The number.
        found: String,
    },
    /// The label cannot be used.
    #[error("the label {found:?} has {problem}")]
    Label {
        /// Its start.
        found: String,
        /// The problem.
        problem: &'static str,
    },
    /// The labels and embeddings of all objects are too large.
    #[error("the names of all objects take more than {} MiB", MAX_BYTES >> 20)]
    TooLarge,
    /// Saved names are damaged.
    #[error("the saved names of objects are damaged: {0}")]
    Damaged(String),
}

/// The names of objects.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct ObjectNames {
    names: BTreeMap<SegmentId, Named>,
    /// Length of the embeddings; `None` without any.
    dimension: Option<usize>,
    /// Number of objects with embeddings.
    embeddings: usize,
    /// Size of all labels and embeddings.
    bytes: usize,
    rooms: RoomNames,
}

#[derive(Clone, Debug, PartialEq)]
struct Named {
    name: ObjectName,
    /// Score of the view that it was named from.
    score: f64,
}

impl ObjectName {
    /// A label that a person gives.
    pub fn by_hand(label: impl Into<String>) -> Self {
        Self { label: Some(label.into()), by_hand: true, ..Self::default() }
    }

    fn bytes(&self) -> usize {
        let alternatives: usize = self.alternatives.iter().map(|other| other.label.len() + 4).sum();
        self.label.as_ref().map_or(0, String::len) + alternatives + size_of_val(self.embedding.as_slice())
    }

    fn is_empty(&self) -> bool {
        self.label.is_none() && self.embedding.is_empty()
    }

    /// The name with its label trimmed, `None` if that leaves nothing.
    fn checked(mut self) -> Result<Self, NameError> {
        self.label = self.label.map(|label| label.trim().to_owned()).filter(|label| !label.is_empty());
        self.alternatives.truncate(MAX_ALTERNATIVES);
        self.label
            .iter()
            .chain(self.alternatives.iter().map(|other| &other.label))
            .try_for_each(|label| check_label(label))?;
        check_finite(&self.embedding)?;
        // JSON has no NaN; a score that is not a number says nothing.
        self.score = self.score.filter(|score| score.is_finite());
        self.alternatives.retain(|other| other.score.is_finite());
        Ok(self)
    }

    fn details(&self) -> Option<LabelDetails> {
        let Self { score, alternatives, by_hand, .. } = self;
        let details = LabelDetails { score: *score, alternatives: alternatives.clone(), by_hand: *by_hand };
        (details != LabelDetails::default()).then_some(details)
    }
}

pub(crate) fn check_label(label: &str) -> Result<(), NameError> {
    let problem = if label.len() > MAX_LABEL_BYTES {
        "more than 1000 bytes"
    } else if label.chars().any(char::is_control) {
        "control characters"
    } else {
        return Ok(());
    };
    Err(NameError::Label { found: label.chars().take(20).collect(), problem })
}

impl ObjectNames {
    /// True if no object and no room was named.
    pub fn is_empty(&self) -> bool {
        self.names.is_empty() && self.rooms.is_empty()
    }

    /// The names of rooms that a person gave.
    pub fn rooms(&self) -> &RoomNames {
        &self.rooms
    }

    /// As [`Self::rooms`], to change them.
    pub fn rooms_mut(&mut self) -> &mut RoomNames {
        &mut self.rooms
    }

    /// The label of an object.
    pub fn label(&self, id: SegmentId) -> Option<&str> {
        self.names.get(&id)?.name.label.as_deref()
    }

    /// Every label, by increasing id.
    pub fn labels(&self) -> impl Iterator<Item = (SegmentId, &str)> {
        self.names.iter().filter_map(|(id, named)| Some((*id, named.name.label.as_deref()?)))
    }

    /// The whole name of an object.
    pub fn name(&self, id: SegmentId) -> Option<&ObjectName> {
        self.names.get(&id).map(|named| &named.name)
    }

    /// Every object that has an embedding, by increasing id.
    pub fn embeddings(&self) -> impl Iterator<Item = (SegmentId, &[f32])> {
        let all = self.names.iter().map(|(id, named)| (*id, named.name.embedding.as_slice()));
        all.filter(|(_, embedding)| !embedding.is_empty())
    }

    /// Every name with the score of the view that it was given from, by increasing id.
    pub fn all(&self) -> impl Iterator<Item = (SegmentId, &ObjectName, f64)> {
        self.names.iter().map(|(id, named)| (*id, &named.name, named.score))
    }

    /// The embedding of an object; empty if it has none.
    pub fn embedding(&self, id: SegmentId) -> &[f32] {
        self.names.get(&id).map_or(&[], |named| &named.name.embedding)
    }

    /// Score of the view from which an object was named.
    pub(crate) fn score(&self, id: SegmentId) -> Option<f64> {
        self.names.get(&id).map(|named| named.score)
    }

    /// Names an object, from a view with this score. Replaces its earlier name; but of one that a person gave, only a person
    /// replaces the label. A label is trimmed, and an empty one is none.
    ///
    /// # Errors
    /// If label or embedding cannot be used: [`NameError`]. The object then keeps its earlier name.
    pub fn set(&mut self, id: SegmentId, name: ObjectName, score: f64) -> Result<(), NameError> {
        let mut name = name.checked()?;
        let earlier = self.names.get(&id).map(|named| &named.name);
        if let Some(kept) = earlier.filter(|earlier| earlier.by_hand && !name.by_hand) {
            name = ObjectName { embedding: name.embedding, ..kept.clone() };
        }
        if !name.embedding.is_empty() {
            self.check_length(&name.embedding)?;
        }
        let replaced = self.names.get(&id).map_or(0, |named| named.name.bytes());
        if self.bytes - replaced + name.bytes() > MAX_BYTES {
            return Err(NameError::TooLarge);
        }
        self.insert(id, Named { name, score });
        Ok(())
    }

    /// Gives objects that are named already other labels, with scores and alternatives. Embeddings stay, and so do labels
    /// that a person gave.
    ///
    /// # Errors
    /// As [`Self::set`], of the first label that cannot be used.
    pub fn relabel(&mut self, labels: impl IntoIterator<Item = (SegmentId, ObjectName)>) -> Result<(), NameError> {
        for (id, name) in labels {
            let Some(named) = self.names.get(&id) else { continue };
            let (embedding, score) = (named.name.embedding.clone(), named.score);
            self.set(id, ObjectName { embedding, ..name }, score)?;
        }
        Ok(())
    }

    /// Gives an object the label of a person, or takes its label away with `None`. Its embedding stays.
    ///
    /// # Errors
    /// As [`Self::set`].
    pub fn set_by_hand(&mut self, id: SegmentId, label: Option<&str>) -> Result<(), NameError> {
        let (embedding, score) =
            self.names.get(&id).map_or_else(Default::default, |named| (named.name.embedding.clone(), named.score));
        let name = label.map_or_else(ObjectName::default, ObjectName::by_hand);
        self.set(id, ObjectName { embedding, by_hand: true, ..name }, score)
    }

    fn insert(&mut self, id: SegmentId, named: Named) {
        self.remove(id);
        if !named.name.embedding.is_empty() {
            self.dimension = Some(named.name.embedding.len());
            self.embeddings += 1;
        }
        self.bytes += named.name.bytes();
        self.names.insert(id, named);
    }

    fn check_length(&self, embedding: &[f32]) -> Result<(), NameError> {
        match self.dimension.filter(|expected| *expected != embedding.len()) {
            Some(expected) => Err(NameError::Length { found: embedding.len(), expected }),
            None => Ok(()),
        }
    }

    fn remove(&mut self, id: SegmentId) -> Option<Named> {
        let named = self.names.remove(&id)?;
        self.bytes -= named.name.bytes();
        self.embeddings -= usize::from(!named.name.embedding.is_empty());
        if self.embeddings == 0 {
            self.dimension = None;
        }
        Some(named)
    }

    /// Drops the name of an object, e.g. because its id now stands for another object.
    pub fn forget(&mut self, id: SegmentId) {
        self.remove(id);
    }

    /// Drops all names of objects but those that a person gave.
    pub fn keep_by_hand(&mut self) {
        let others = self.names.iter().filter(|(_, named)| !named.name.by_hand);
        let others: Vec<SegmentId> = others.map(|(id, _)| *id).collect();
        others.into_iter().for_each(|id| self.forget(id));
        for named in self.names.values_mut() {
            named.score = 0.0;
        }
    }

    /// Drops the names of all objects but these.
    pub fn keep_only(&mut self, ids: &BTreeSet<SegmentId>) {
        let others: Vec<SegmentId> = self.names.keys().filter(|id| !ids.contains(id)).copied().collect();
        others.into_iter().for_each(|id| self.forget(id));
    }

    /// Drops the embeddings of all objects but these. Labels stay, for the list of all objects of a run.
    pub fn keep_embeddings_of(&mut self, ids: &BTreeSet<SegmentId>) {
        let has_embedding = |named: &Named| !named.name.embedding.is_empty();
        let others = self.names.iter().filter(|(id, named)| has_embedding(named) && !ids.contains(*id));
        let others: Vec<SegmentId> = others.map(|(id, _)| *id).collect();
        for id in others {
            if let Some(mut named) = self.remove(id) {
                named.name.embedding = Vec::new();
                self.insert(id, named);
            }
        }
    }

    /// Gives the names of ids that turned out to be other ids' objects to those. Of two names, the one that a person gave
    /// stays, else the one from the better view, and one without label and embedding never does.
    pub fn remap(&mut self, remapped: &[RemappedId]) {
        for RemappedId { from, into } in remapped.iter().filter(|remapped| remapped.from != remapped.into) {
            let Some(other) = self.remove(*from) else { continue };
            let rank = |named: &Named| (!named.name.is_empty(), named.name.by_hand, named.score);
            if self.names.get(into).is_none_or(|kept| rank(&other) > rank(kept)) {
                self.insert(*into, other);
            }
        }
    }

    /// The objects with embeddings and the cosine of the angle between theirs and this one, -1 to 1: most similar first,
    /// equally similar ones by id. A vector of zeros has similarity 0 to all.
    ///
    /// # Errors
    /// [`NameError::Length`] if the objects' embeddings have another length, [`NameError::NotFinite`].
    pub fn find(&self, embedding: &[f32]) -> Result<Vec<(SegmentId, f32)>, NameError> {
        check_finite(embedding)?;
        self.check_length(embedding)?;
        let named = self.names.iter().filter(|(_, named)| !named.name.embedding.is_empty());
        let mut found: Vec<(SegmentId, f32)> =
            named.map(|(id, named)| (*id, cosine(embedding, &named.name.embedding))).collect();
        found.sort_by(|(one_id, one), (other_id, other)| other.total_cmp(one).then(one_id.cmp(other_id)));
        Ok(found)
    }

    /// The objects whose label contains the text, upper or lower case, by increasing id.
    pub fn find_label(&self, text: &str) -> Vec<SegmentId> {
        let text = text.to_lowercase();
        self.labels().filter(|(_, label)| label.to_lowercase().contains(&text)).map(|(id, _)| id).collect()
    }

    /// The names as bytes of a [`StateBlock`], to be saved with a map.
    pub fn to_bytes(&self) -> Vec<u8> {
        let mut block = StateBlock::default();
        let all = || self.names.iter();
        let embedded = || all().filter(|(_, named)| !named.name.embedding.is_empty());
        block.put("id", &[], all().map(|(id, _)| *id));
        block.put("score", &[], all().map(|(_, named)| named.score));
        block.put_json("labels.json", &all().map(|(_, named)| named.name.label.as_deref()).collect::<Vec<_>>());
        let details: Vec<Option<LabelDetails>> = all().map(|(_, named)| named.name.details()).collect();
        if details.iter().any(Option::is_some) {
            block.put_json("details.json", &details);
        }
        if let Some(dimension) = self.dimension {
            block.put("embedding_id", &[], embedded().map(|(id, _)| *id));
            block.put(
                "embedding",
                &[dimension],
                embedded().flat_map(|(_, named)| named.name.embedding.iter().copied()),
            );
        }
        if let Some(rooms) = self.rooms.to_json() {
            block.put_json("rooms.json", &rooms);
        }
        // The header of seven arrays is never too long.
        block.to_bytes().unwrap_or_default()
    }

    /// The names from the bytes of a saved map.
    ///
    /// # Errors
    /// [`NameError::Damaged`], or what [`Self::set`] refuses.
    pub fn from_bytes(bytes: &[u8]) -> Result<Self, NameError> {
        let damaged = |error: StateError| NameError::Damaged(error.to_string());
        let block = StateBlock::from_bytes(bytes).map_err(damaged)?;
        let text: Vec<u8> = block.get(StateBlock::OLD_TEXT, &[]).map_err(damaged)?;
        let saved = if text.is_empty() { saved_names(&block).map_err(damaged)? } else { old_names::converted(&text)? };
        let rooms: Vec<RoomName> = block.get_json("rooms.json").map_err(damaged)?.unwrap_or_default();
        let mut names = Self { rooms: RoomNames::checked(rooms)?, ..Self::default() };
        for SavedName { id, name, score } in saved {
            let wrong = |problem: &str| NameError::Damaged(format!("object {id} {problem}"));
            if id == 0 || names.names.contains_key(&id) {
                return Err(wrong("occurs twice, or its id is 0"));
            }
            if !(score.is_finite() && score >= 0.0) {
                return Err(wrong("has a view with an impossible score"));
            }
            names.set(id, name, score)?;
        }
        Ok(names)
    }
}

/// A name in a file.
pub(crate) struct SavedName {
    pub(crate) id: SegmentId,
    pub(crate) name: ObjectName,
    /// Of the view.
    pub(crate) score: f64,
}

/// The names in the arrays of a file.
fn saved_names(block: &StateBlock) -> Result<Vec<SavedName>, StateError> {
    let ids: Vec<SegmentId> = block.get("id", &[])?;
    let scores: Vec<f64> = block.get_rows("score", ids.len(), &[])?;
    let labels: Vec<Option<String>> = block.get_json("labels.json")?.unwrap_or_default();
    let details: Vec<Option<LabelDetails>> = block.get_json("details.json")?.unwrap_or_else(|| vec![None; ids.len()]);
    let embedding_ids: Vec<SegmentId> = block.get("embedding_id", &[])?;
    let (dimension, numbers): (usize, Vec<f32>) = block.get_matrix("embedding")?;
    let unequal = |name: &str, found: usize, expected: usize| StateError::Array {
        name: name.to_owned(),
        found: format!("{found} entries"),
        expected: expected.to_string(),
    };
    if labels.len() != ids.len() {
        return Err(unequal("labels.json", labels.len(), ids.len()));
    }
    if details.len() != ids.len() {
        return Err(unequal("details.json", details.len(), ids.len()));
    }
    let embeddings = numbers.chunks_exact(dimension.max(1));
    if embeddings.len() != embedding_ids.len() {
        return Err(unequal("embedding", embeddings.len(), embedding_ids.len()));
    }
    let of_id: BTreeMap<SegmentId, &[f32]> = embedding_ids.into_iter().zip(embeddings).collect();
    let rest = scores.into_iter().zip(labels).zip(details);
    let mut names = Vec::with_capacity(ids.len());
    for (id, ((score, label), details)) in ids.into_iter().zip(rest) {
        let embedding = of_id.get(&id).map_or_else(Vec::new, |embedding| embedding.to_vec());
        let LabelDetails { score: label_score, alternatives, by_hand } = details.unwrap_or_default();
        let name = ObjectName { label, embedding, score: label_score, alternatives, by_hand };
        names.push(SavedName { id, name, score });
    }
    Ok(names)
}

fn check_finite(embedding: &[f32]) -> Result<(), NameError> {
    match embedding.iter().enumerate().find(|(_, number)| !number.is_finite()) {
        Some((index, number)) => Err(NameError::NotFinite { index, found: number.to_string() }),
        None => Ok(()),
    }
}

/// The cosine of the angle between two vectors, 0 if one has no length. Summed in order, so that it is the same
/// everywhere.
fn cosine(one: &[f32], other: &[f32]) -> f32 {
    let dot = |one: &[f32], other: &[f32]| -> f64 {
        one.iter().zip(other).map(|(one, other)| f64::from(*one) * f64::from(*other)).sum()
    };
    let lengths = (dot(one, one) * dot(other, other)).sqrt();
    if lengths > 0.0 { (dot(one, other) / lengths) as f32 } else { 0.0 }
}
