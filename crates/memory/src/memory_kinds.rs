//! The kinds of memory that `memory.kind` chooses from: the built-in ones, and those of other crates.

use crate::evidence::EvidenceStore;
use crate::features::{FeatureStore, SegmentCodes};
use crate::segment_store::SegmentStore;
use crate::{LoadMemoryError, MemoryError, MemoryRules, MemorySettings, SplatContent};
use serde::de::Error as _;
use serde::{Deserialize, Deserializer, Serialize, Serializer};
use splatseg_geometry::SegmentId;
use splatseg_settings::{Allowed, SettingValue};
use std::fmt;
use std::path::Path;
use std::sync::{Mutex, PoisonError};
use thiserror::Error;

/// How Gaussians remember segments.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[non_exhaustive]
pub enum MemoryKind {
    /// Votes for the segments that each Gaussian was predicted as.
    #[default]
    Evidence,
    /// The paper's feature vectors, learnt by gradient descent.
    Features,
    /// A kind that another crate has added; see [`register_memory_kind`].
    Registered(RegisteredKind),
}

/// What makes a kind of memory: its name, its rules and its stores.
pub struct MemoryKindDefinition {
    /// The name that chooses it: lower-case letters, digits, `-` and `_`.
    pub name: &'static str,
    /// What it asks of the map and of the methods: the same as [`SegmentStore::rules`] of its stores.
    pub rules: fn(&MemorySettings) -> MemoryRules,
    /// Creates the store of a map without Gaussians.
    pub create: fn(&MemorySettings, NewStore<'_>) -> Result<Box<dyn SegmentStore>, MemoryError>,
    /// Creates the store of a saved map from its content, which is [`SegmentStore::content`] of the store that was
    /// saved.
    pub restore: fn(&MemorySettings, SavedStore<'_>) -> Result<Box<dyn SegmentStore>, LoadMemoryError>,
}

/// What a new store may use besides its settings.
pub struct NewStore<'a> {
    /// Seed of all random numbers.
    pub seed: u64,
    /// Receives the fraction done, if creating the store takes long.
    pub progress: &'a mut dyn FnMut(f32),
}

/// What a saved map contains for its store.
pub struct SavedStore<'a> {
    /// The file, for errors.
    pub path: &'a Path,
    /// One entry per Gaussian.
    pub content: SplatContent,
    /// The largest id that was ever given out.
    pub highest_id: SegmentId,
}

impl SavedStore<'_> {
    /// The error for content of another kind of memory than the settings choose.
    pub fn unexpected(&self, settings: &MemorySettings) -> LoadMemoryError {
        let path = self.path.display().to_string();
        LoadMemoryError::Kind { path, found: self.content.kind().name(), expected: settings.kind.name() }
    }
}

/// An error registering a kind of memory.
#[derive(Clone, Debug, Error, PartialEq, Eq)]
#[non_exhaustive]
pub enum RegisterKindError {
    /// Another kind has the name.
    #[error("there is already a kind of memory named {0}")]
    Taken(&'static str),
    /// The name cannot be written in settings.
    #[error("the name of a kind of memory is {0:?}, expected lower-case letters, digits, - and _")]
    Name(&'static str),
}

const EVIDENCE: MemoryKindDefinition = MemoryKindDefinition {
    name: "evidence",
    rules: |_| MemoryRules::default(),
    create: |settings, _| Ok(Box::new(EvidenceStore::new(settings.clone()))),
    restore: |settings, saved| match saved.content {
        SplatContent::Evidence { votes } => Ok(Box::new(EvidenceStore::restored(settings.clone(), votes))),
        SplatContent::Features { .. } => Err(saved.unexpected(settings)),
    },
};

const FEATURES: MemoryKindDefinition = MemoryKindDefinition {
    name: "features",
    rules: FeatureStore::rules_of,
    create: |settings, new| Ok(Box::new(FeatureStore::new(settings.clone(), new.seed, new.progress)?)),
    restore: |settings, saved| match saved.content {
        SplatContent::Evidence { .. } => Err(saved.unexpected(settings)),
        SplatContent::Features { features, codebook } => {
            let (found, expected) = (codebook.feature_dim(), settings.feature_dim);
            if found != expected {
                let path = saved.path.display().to_string();
                return Err(LoadMemoryError::FeatureDim { path, found, expected });
            }
            let codes = SegmentCodes::of_user(settings, codebook, saved.highest_id as usize);
            Ok(Box::new(FeatureStore::restored(settings.clone(), codes, features)))
        }
    },
};

/// The kinds of other crates, and the names of all kinds.
struct Registered {
    kinds: Vec<RegisteredKind>,
    names: &'static [&'static str],
}

static REGISTERED: Mutex<Registered> =
    Mutex::new(Registered { kinds: Vec::new(), names: &[EVIDENCE.name, FEATURES.name] });

/// Adds a kind of memory to those that `memory.kind` chooses from, for the whole program. Call it before settings are
/// read.
///
/// It is saved if its stores have a [`SegmentStore::content`]. The file then has the votes or features of a built-in
/// kind, not the name of this one, so `memory.kind` must be given again to load it as this kind.
///
/// # Errors
/// If the name is taken or cannot be written.
pub fn register_memory_kind(definition: &'static MemoryKindDefinition) -> Result<MemoryKind, RegisterKindError> {
    let name = definition.name;
    let is_plain = |byte: u8| byte.is_ascii_lowercase() || byte.is_ascii_digit() || b"-_".contains(&byte);
    if name.is_empty() || !name.bytes().all(is_plain) {
        return Err(RegisterKindError::Name(name));
    }
    let mut registered = REGISTERED.lock().unwrap_or_else(PoisonError::into_inner);
    if registered.names.contains(&name) {
        return Err(RegisterKindError::Taken(name));
    }
    let kind = RegisteredKind(definition);
    registered.kinds.push(kind);
    // Descriptions of settings hold the names forever. There is one list per kind that is added.
    registered.names = [registered.names, &[name]].concat().leak();
    Ok(MemoryKind::Registered(kind))
}

impl MemoryKind {
    /// Returns the names of all kinds.
    pub fn names() -> &'static [&'static str] {
        REGISTERED.lock().unwrap_or_else(PoisonError::into_inner).names
    }

    /// Returns the kind with this name, if there is one.
    pub fn from_name(name: &str) -> Option<Self> {
        let registered = REGISTERED.lock().unwrap_or_else(PoisonError::into_inner);
        let registered = registered.kinds.iter().map(|kind| Self::Registered(*kind));
        [Self::Evidence, Self::Features].into_iter().chain(registered).find(|kind| kind.name() == name)
    }

    /// Returns the name used in settings and files.
    pub fn name(self) -> &'static str {
        self.definition().name
    }

    /// Returns what the kind asks of the map and of the methods.
    pub fn rules(self, settings: &MemorySettings) -> MemoryRules {
        (self.definition().rules)(settings)
    }

    pub(crate) fn definition(self) -> &'static MemoryKindDefinition {
        match self {
            Self::Evidence => &EVIDENCE,
            Self::Features => &FEATURES,
            Self::Registered(kind) => kind.0,
        }
    }
}

impl fmt::Display for MemoryKind {
    fn fmt(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        formatter.write_str(self.name())
    }
}

impl SettingValue for MemoryKind {
    fn text(&self) -> Option<String> {
        Some(format!("\"{self}\""))
    }

    fn is_allowed(&self, _: &Allowed) -> bool {
        true
    }
}

impl Serialize for MemoryKind {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        serializer.serialize_str(self.name())
    }
}

impl<'de> Deserialize<'de> for MemoryKind {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        let name = String::deserialize(deserializer)?;
        Self::from_name(&name).ok_or_else(|| D::Error::unknown_variant(&name, Self::names()))
    }
}

/// A kind of memory that another crate has added. Names are unique, so a kind is compared by its name.
#[derive(Clone, Copy)]
pub struct RegisteredKind(&'static MemoryKindDefinition);

impl PartialEq for RegisteredKind {
    fn eq(&self, other: &Self) -> bool {
        self.0.name == other.0.name
    }
}

impl Eq for RegisteredKind {}

impl fmt::Debug for RegisteredKind {
    fn fmt(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        formatter.write_str(self.0.name)
    }
}
