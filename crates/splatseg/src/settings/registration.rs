//! Segmenters, trackers, namers and depth predictors of other crates, chosen by their names like the built-in ones.

use super::entries;
use crate::parts::{Namer, PartKind, PartSection, RegisterError};
use splatseg_depth::DepthPredictor;
use splatseg_segmenter::Segmenter;
use splatseg_tracking::Tracker;
use std::sync::{Mutex, PoisonError};

/// Adds a segmenter to those that the setting `segmenter` chooses from, for the whole program. Its settings and files
/// are then read, checked, listed and written like those of a built-in one. Call it before settings are read.
///
/// # Errors
/// If its name is taken or cannot be written, or one of its settings has the key or the section of another setting.
pub fn register_segmenter<S: PartSection<dyn Segmenter>>() -> Result<(), RegisterError> {
    register::<dyn Segmenter, S>()
}

/// Adds a tracker to those that the setting `tracker` chooses from, as [`register_segmenter`] does.
///
/// # Errors
/// As [`register_segmenter`].
pub fn register_tracker<S: PartSection<dyn Tracker>>() -> Result<(), RegisterError> {
    register::<dyn Tracker, S>()
}

/// Adds a namer to those that the setting `namer` chooses from, as [`register_segmenter`] does. Without a namer there is
/// no such setting.
///
/// # Errors
/// As [`register_segmenter`].
pub fn register_namer<S: PartSection<dyn Namer>>() -> Result<(), RegisterError> {
    register::<dyn Namer, S>()
}

/// Adds a depth predictor to those that the setting `depth_predictor` chooses from, as [`register_segmenter`] does.
///
/// # Errors
/// As [`register_segmenter`].
pub fn register_depth_predictor<S: PartSection<dyn DepthPredictor>>() -> Result<(), RegisterError> {
    register::<dyn DepthPredictor, S>()
}

fn register<T: PartKind + ?Sized, S: PartSection<T>>() -> Result<(), RegisterError> {
    /// Two parts with the same settings must not be registered at once.
    static ONE_AT_A_TIME: Mutex<()> = Mutex::new(());
    let _guard = ONE_AT_A_TIME.lock().unwrap_or_else(PoisonError::into_inner);
    T::table().check_name::<S>()?;
    let (kind, name) = (T::KEY, S::NAME);
    if let Some((key, other)) = conflict::<T, S>() {
        return Err(RegisterError::Setting { kind, name, key, other });
    }
    T::table().add::<S>();
    Ok(())
}

/// Returns the first setting of a part that has the key or the section of another setting, and that.
fn conflict<T: PartKind + ?Sized, S: PartSection<T>>() -> Option<(String, String)> {
    let entries = entries();
    let others: Vec<String> = entries.iter().map(|entry| entry.field.key()).collect();
    // Parts of a kind may share the settings that name their files.
    let shared: Vec<&str> = T::table().parts().iter().flat_map(|part| part.files).map(|file| file.key).collect();
    let files = S::FILES.iter().map(|file| file.key).filter(|key| !shared.contains(key)).map(str::to_owned);
    let first = |key: &str| key.split('.').next().unwrap_or_default().to_owned();
    files.chain(S::fields().iter().map(splatseg_settings::Field::key)).find_map(|key| {
        let other = others.iter().find(|other| first(other) == first(&key))?;
        Some((key, other.clone()))
    })
}
