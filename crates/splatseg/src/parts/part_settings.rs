//! A chosen part with its settings.

use super::section::AnySection;
use super::{MissingFile, Part, PartContext, PartError, PartFiles, PartKind, PartSection, SettingsInput};
use serde::ser::Error as _;
use serde::{Serialize, Serializer};
use splatseg_settings::SettingError;
use std::fmt;
use std::path::{Path, PathBuf};
use toml::{Table, Value};

/// A part with its settings. `T` is what is built, e.g. `dyn Segmenter`.
///
/// ```
/// use splatseg::settings::SegmenterSettings;
/// use splatseg::segmenter::GraphSettings;
///
/// let mut segmenter = SegmenterSettings::of(GraphSettings::default().with(|graph| graph.lightness = 0.5));
/// assert_eq!(segmenter.name(), "graph");
/// if let Some(graph) = segmenter.section_mut::<GraphSettings>() {
///     graph.lightness = 0.6;
/// }
/// ```
pub struct PartSettings<T: ?Sized> {
    part: Part<T>,
    files: PartFiles,
    section: Box<dyn AnySection<T>>,
}

impl<T: PartKind + ?Sized> PartSettings<T> {
    /// Chooses the part that these settings belong to. It need not be registered, unless settings are also read from
    /// files.
    pub fn of<S: PartSection<T>>(section: S) -> Self {
        Self { part: Part::of::<S>(), files: PartFiles::default(), section: Box::new(section) }
    }

    /// Names a file or folder for the part by the key of its setting, e.g. `weights`. A key that the part does not have
    /// is an error of [`Settings::validate`](crate::Settings::validate).
    #[must_use]
    pub fn with_file(mut self, key: &'static str, path: impl Into<PathBuf>) -> Self {
        self.files.0.insert(key, path.into());
        self
    }

    /// Returns the name of the part.
    pub fn name(&self) -> &'static str {
        self.part.name
    }

    /// Returns the settings of the part, if they have this type.
    pub fn section<S: PartSection<T>>(&self) -> Option<&S> {
        self.section.as_any().downcast_ref()
    }

    /// Returns the settings of the part to be changed, if they have this type.
    pub fn section_mut<S: PartSection<T>>(&mut self) -> Option<&mut S> {
        self.section.as_any_mut().downcast_mut()
    }

    /// Returns the files and folders that are named for the part.
    pub fn files(&self) -> &PartFiles {
        &self.files
    }

    /// Replaces the paths of the files and folders.
    pub(crate) fn change_paths(&mut self, change: &impl Fn(&Path) -> PathBuf) {
        self.files.0.values_mut().for_each(|path| *path = change(path));
    }

    pub(crate) fn validate(&self) -> Result<(), SettingError> {
        self.section.validate()?;
        let is_known = |key: &str| self.part.files.iter().any(|file| file.key == key);
        match self.files.0.iter().find(|(key, _)| !is_known(key)) {
            None => Ok(()),
            Some((key, path)) => Err(SettingError {
                key: (*key).to_owned(),
                found: path.display().to_string(),
                expected: format!("no value: {} = {} reads no such file", T::KEY, self.name()),
            }),
        }
    }

    /// Returns true if the part is a network, which runs on the device of the settings.
    pub(crate) fn is_network(&self) -> bool {
        self.part.is_network
    }

    /// Returns true if the part is missing in a program without the feature `networks`.
    pub(crate) fn needs_networks(&self) -> bool {
        self.part.needs_networks
    }

    /// Returns the first file or folder that the part needs and the settings do not name.
    pub(crate) fn missing_input(&self) -> Option<MissingFile> {
        let missing = self.part.files.iter().find(|file| file.is_required && self.files.get(file).is_none())?;
        Some(MissingFile { chosen: format!("{} = {}", T::KEY, self.name()), key: missing.key, what: missing.what })
    }

    /// Returns the files and folders that the part reads.
    pub(crate) fn inputs(&self, is_of_segmenter: bool) -> impl Iterator<Item = SettingsInput<'_>> {
        self.part.files.iter().filter_map(move |file| {
            let path = self.files.get(file)?;
            Some(SettingsInput { what: file.called, path, is_checkpoint: file.is_checkpoint, is_of_segmenter })
        })
    }

    /// Reads the part and its settings from a table of checked values; `None` if none is chosen and there is no
    /// default.
    pub(super) fn chosen_in(table: &Table) -> Result<Option<Self>, SettingError> {
        let name = table.get(T::KEY).and_then(Value::as_str);
        let named = Part::<T>::all().into_iter().find(|part| Some(part.name) == name);
        let Some(part) = named.or(T::DEFAULT) else { return Ok(None) };
        let path = |key| Some((key, PathBuf::from(table.get(key).and_then(Value::as_str)?)));
        let files = PartFiles(part.files.iter().filter_map(|file| path(file.key)).collect());
        Ok(Some(Self { part, files, section: (part.read)(table)? }))
    }

    /// Writes the name of the part, its files and its settings, as they are read.
    fn to_table(&self) -> Result<Table, String> {
        let mut table = Table::new();
        table.insert(T::KEY.to_owned(), self.name().into());
        for (key, path) in &self.files.0 {
            let path = path.to_str().ok_or("path contains invalid UTF-8 characters")?;
            table.insert((*key).to_owned(), path.into());
        }
        let own = self.section.to_table()?;
        match self.part.section {
            "" => table.extend(own),
            section => _ = table.insert(section.to_owned(), own.into()),
        }
        Ok(table)
    }

    /// Builds the part.
    ///
    /// # Errors
    /// As [`PartSection::build`].
    pub(crate) fn build(&self, context: &PartContext<'_>) -> Result<Box<T>, PartError> {
        self.section.build(&self.files, context)
    }
}

impl<T: PartKind + ?Sized> Serialize for PartSettings<T> {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        self.to_table().map_err(S::Error::custom)?.serialize(serializer)
    }
}

// Derived implementations would need `T: Clone` and so on.
impl<T: ?Sized> Clone for PartSettings<T> {
    fn clone(&self) -> Self {
        Self { part: self.part, files: self.files.clone(), section: self.section.cloned() }
    }
}

impl<T: ?Sized> PartialEq for PartSettings<T> {
    fn eq(&self, other: &Self) -> bool {
        self.part.name == other.part.name && self.files == other.files && self.section.equals(other.section.as_ref())
    }
}

impl<T: ?Sized> fmt::Debug for PartSettings<T> {
    fn fmt(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        formatter.debug_struct(self.part.name).field("files", &self.files.0).field("settings", &self.section).finish()
    }
}
