//! Definitions of the kinds of memory that `memory.kind` selects: the built-in ones, and those of other crates.

use crate::evidence::EvidenceStore;
use crate::features::{FeatureStore, SegmentCodes};
use crate::memory_kind::{MemoryKind, RegisterKindError};
use crate::segment_store::SegmentStore;
use crate::{LoadMemoryError, MemoryError, MemoryRules, MemorySettings, SplatContent};
use splatseg_geometry::SegmentId;
use std::path::Path;
use std::sync::{Mutex, PoisonError};

/// Creates the store of a map without Gaussians.
pub type CreateStore = fn(&MemorySettings, NewStore<'_>) -> Result<Box<dyn SegmentStore>, MemoryError>;

/// Creates the store of a saved map from its content.
pub type RestoreStore = fn(&MemorySettings, SavedStore<'_>) -> Result<Box<dyn SegmentStore>, LoadMemoryError>;

/// Definition of a kind of memory: its name, its rules and its stores.
pub struct MemoryKindDefinition {
    /// The value of `memory.kind` that selects it: lower-case letters, digits, `-` and `_`.
    pub name: &'static str,
    /// Its rules for the map and the methods: the same as [`SegmentStore::rules`] of its stores.
    pub rules: fn(&MemorySettings) -> MemoryRules,
    /// Creates the store of a map without Gaussians.
    pub create: CreateStore,
    /// Creates the store of a saved map from its content, which is [`SegmentStore::content`] of the store that was
    /// saved.
    pub restore: RestoreStore,
}

/// Inputs of a new store besides its settings.
pub struct NewStore<'a> {
    /// Seed of all random numbers.
    pub seed: u64,
    /// Receives the fraction done, if creating the store takes long.
    pub progress: &'a mut dyn FnMut(f32),
}

/// The part of a saved map that belongs to its store.
pub struct SavedStore<'a> {
    /// The file, for errors.
    pub path: &'a Path,
    /// One entry per Gaussian; arrays are as long as they were when they were saved, and no number in them is checked.
    pub content: SplatContent,
    /// Number of Gaussians.
    pub gaussians: usize,
    /// The largest id that was ever given out.
    pub highest_id: SegmentId,
}

impl SavedStore<'_> {
    /// The error for content of another kind of memory than the settings choose.
    pub fn unexpected(&self, settings: &MemorySettings) -> LoadMemoryError {
        let path = self.path.display().to_string();
        LoadMemoryError::Kind { path, found: self.content.name().to_owned(), expected: settings.kind.name() }
    }
}

static EVIDENCE: MemoryKindDefinition = MemoryKindDefinition {
    name: MemoryKind::Evidence.name(),
    rules: |_| MemoryRules::default(),
    create: |settings, _| Ok(Box::new(EvidenceStore::new(settings.clone()))),
    restore: |settings, saved| match saved.content {
        SplatContent::Evidence { votes } => Ok(Box::new(EvidenceStore::restored(settings.clone(), votes))),
        _ => Err(saved.unexpected(settings)),
    },
};

static FEATURES: MemoryKindDefinition = MemoryKindDefinition {
    name: MemoryKind::Features.name(),
    rules: FeatureStore::rules_of,
    create: |settings, new| Ok(Box::new(FeatureStore::new(settings.clone(), new.seed, new.progress)?)),
    restore: |settings, saved| match saved.content {
        SplatContent::Features { features, codebook } => {
            let (found, expected) = (codebook.feature_dim(), settings.feature_dim);
            if found != expected {
                let path = saved.path.display().to_string();
                return Err(LoadMemoryError::FeatureDim { path, found, expected });
            }
            let codes = SegmentCodes::of_user(settings, codebook, saved.highest_id as usize);
            Ok(Box::new(FeatureStore::restored(settings.clone(), codes, features)))
        }
        _ => Err(saved.unexpected(settings)),
    },
};

/// The kinds of other crates.
static REGISTERED: Mutex<Vec<&'static MemoryKindDefinition>> = Mutex::new(Vec::new());

/// Adds a kind of memory to those that `memory.kind` chooses from, for the whole program. Call it before settings are
/// read.
///
/// It is saved if its stores have a [`SegmentStore::content`]: votes or features as those of a built-in kind, or arrays of
/// its own. The file then has the name of the kind, and a program that has not registered it refuses to continue the map.
///
/// # Errors
/// If the name is taken or cannot be written.
pub fn register_memory_kind(definition: &'static MemoryKindDefinition) -> Result<MemoryKind, RegisterKindError> {
    let mut registered = REGISTERED.lock().unwrap_or_else(PoisonError::into_inner);
    let kind = MemoryKind::add(definition.name)?;
    registered.push(definition);
    Ok(kind)
}

impl MemoryKind {
    /// Returns what the kind asks of the map and of the methods.
    pub fn rules(self, settings: &MemorySettings) -> MemoryRules {
        (self.definition().rules)(settings)
    }

    pub(crate) fn definition(self) -> &'static MemoryKindDefinition {
        let registered = REGISTERED.lock().unwrap_or_else(PoisonError::into_inner);
        match self {
            Self::Evidence => &EVIDENCE,
            Self::Features => &FEATURES,
            // There is one for each registered name.
            kind => registered.iter().find(|known| known.name == kind.name()).copied().unwrap_or(&EVIDENCE),
        }
    }
}
