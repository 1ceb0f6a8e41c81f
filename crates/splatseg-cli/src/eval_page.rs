//! `splatseg eval --page`: true ids on the page of a run.

use super::Failure;
use super::manifest::{MANIFEST, Manifest, listed_files, place};
use splatseg::evaluation::ScoredFrame;
use splatseg_annotations::Prediction;
use splatseg_metrics::VideoScore;
use splatseg_output::{ComparedIds, OutputError, Page, ResultFolder, write_atomically};
use std::path::{Path, PathBuf};

/// The page of a run, and the ids that it is compared with.
pub struct ComparedPage {
    ids: ComparedIds,
    folder: PageFolder,
}

/// The folder of a run, whose list of files, if it has one, gets those that are written.
struct PageFolder {
    path: PathBuf,
    manifest: Option<Manifest>,
}

impl ComparedPage {
    /// The page of these predictions, which must be those of a run.
    pub fn open(predictions: &Path, is_run: bool) -> Result<Self, Failure> {
        let path = match predictions.parent() {
            Some(parent) if predictions.file_name().is_some_and(|name| name == "segments") => parent,
            _ => predictions,
        };
        if !is_run || !path.join(Page::FILE).is_file() {
            let text = "--page: found no page, expected the folder of a run with one";
            return Err(Failure::input(format!("{}: {text}", predictions.display())));
        }
        Ok(Self { ids: ComparedIds::default(), folder: PageFolder { path: path.to_owned(), manifest: None } })
    }

    /// Adds a frame.
    pub fn add(&mut self, frame: &ScoredFrame<'_>) {
        if let (Some(file), Prediction::Map(own)) = (frame.image.and_then(Path::file_stem), frame.prediction) {
            self.ids.add(&file.to_string_lossy(), own, frame.truth);
        }
    }

    /// Writes the comparison, and says what the page shows: `name`.
    pub fn write(mut self, name: &str, score: &VideoScore) -> Result<(), Failure> {
        let folder = &mut self.folder;
        if folder.path.join(MANIFEST).exists() {
            let listed = listed_files(&folder.path)?;
            folder.manifest = Some(Manifest::resume(&folder.path, &listed).map_err(Failure::runtime)?);
        }
        let figure = format!("{} · {}", self.ids.figure(), quality(score));
        self.ids.write(folder, name, &figure).map_err(Failure::runtime)?;
        inform!("{}: shows {name}: {figure}", folder.path.join(Page::FILE).display());
        Ok(())
    }
}

impl ResultFolder for PageFolder {
    fn write(&mut self, file: &str, bytes: &[u8]) -> Result<(), OutputError> {
        let path = self.path_of(file);
        if let Some(manifest) = &mut self.manifest {
            manifest.add(&[file]).map_err(|source| OutputError::Io { path: path.clone(), source })?;
        }
        write_atomically(&path, bytes)
    }

    fn remove(&mut self, file: &str) -> Result<(), OutputError> {
        let path = self.path_of(file);
        match std::fs::remove_file(&path) {
            Err(source) if source.kind() != std::io::ErrorKind::NotFound => Err(OutputError::Io { path, source }),
            _ => Ok(()),
        }
    }

    fn path_of(&self, file: &str) -> PathBuf {
        place(&self.path, file)
    }
}

/// The scores that the page shows, percent.
fn quality(score: &VideoScore) -> String {
    let scores = score.scores();
    let named = [("VSQ", scores.vsq), ("AQ", scores.aq)];
    let texts = named.into_iter().filter_map(|(name, value)| Some(format!("{name} {:.1} %", value?)));
    texts.collect::<Vec<_>>().join(", ")
}
