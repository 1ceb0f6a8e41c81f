//! A network for images and words with its vocabulary.

use super::crops::crops;
use super::label_choice::LabelChoice;
use super::vocabulary::{Vocabulary, VocabularyError};
use splatseg_geometry::{Image, SegmentId};
use splatseg_models::clip::{ClipError, ClipNetwork, Pacer};
use splatseg_objects::{NameError, ObjectName, ObjectNames, ObjectView};
use std::path::Path;
use std::sync::OnceLock;
use thiserror::Error;

/// Words for anything: an object that they fit best is unknown.
const ANYTHING: [&str; 6] = ["object", "thing", "surface", "background", "part of something", "room"];

/// An error naming objects with a network.
#[derive(Debug, Error)]
#[non_exhaustive]
pub enum NamesError {
    /// The network cannot be used.
    #[error(transparent)]
    Network(#[from] ClipError),
    /// The vocabulary cannot be used.
    #[error(transparent)]
    Vocabulary(#[from] VocabularyError),
    /// The names of the map are from another network.
    #[error(transparent)]
    Names(#[from] NameError),
}

/// A network for images and words, and the labels that it chooses from.
#[derive(Debug)]
pub struct ClipNames {
    network: ClipNetwork,
    vocabulary: Vocabulary,
    /// Least probability of a label, 0 to 1.
    min_score: f64,
    /// The words of each label, and those for anything; computed when they are needed.
    embeddings: OnceLock<Vec<Vec<Vec<f32>>>>,
}

impl ClipNames {
    /// Default of the setting `clip.min_score`.
    pub const MIN_SCORE: f64 = 0.15;

    /// Loads a network, and a vocabulary if there is one of your own. See [`ClipNetwork::open`] and
    /// [`Vocabulary::read`].
    ///
    /// # Errors
    /// [`NamesError`] if a file cannot be used.
    pub fn open(network: &Path, vocabulary: Option<&Path>) -> Result<Self, NamesError> {
        let vocabulary = vocabulary.map_or_else(|| Ok(Vocabulary::built_in()), Vocabulary::read)?;
        Ok(Self::new(ClipNetwork::open(network)?, vocabulary))
    }

    /// Names with a network and a vocabulary.
    pub fn new(network: ClipNetwork, vocabulary: Vocabulary) -> Self {
        Self { network, vocabulary, min_score: Self::MIN_SCORE, embeddings: OnceLock::new() }
    }

    /// Sets the least probability of a label, 0 to 1: objects without a label of that probability are unknown.
    #[must_use]
    pub fn with_min_score(mut self, min_score: f64) -> Self {
        self.min_score = min_score;
        self
    }

    /// Replaces the vocabulary.
    #[must_use]
    pub fn with_vocabulary(self, vocabulary: Vocabulary) -> Self {
        Self { min_score: self.min_score, ..Self::new(self.network, vocabulary) }
    }

    /// The network.
    pub const fn network(&self) -> &ClipNetwork {
        &self.network
    }

    /// The vocabulary.
    pub const fn vocabulary(&self) -> &Vocabulary {
        &self.vocabulary
    }

    /// The embedding of an object from views of it, the best first, each with its weight: the mean of those of the crops of
    /// each view with the surroundings dimmed and, of the best, also as they are.
    ///
    /// # Errors
    /// [`ClipError::NotFinite`].
    pub fn embed_views(&self, views: &[(&ObjectView, f64)]) -> Result<Vec<f32>, ClipError> {
        let (seen, weights) = self.images_of_views(views, || {});
        let embeddings = self.network.embed_images(&seen)?;
        Ok(weighted_mean(embeddings.iter().map(Vec::as_slice).zip(weights)))
    }

    /// [`Self::embed_views`] in steps of a few milliseconds, with the same result.
    ///
    /// # Errors
    /// As [`Self::embed_views`].
    pub fn embed_views_in_steps(&self, views: &[(&ObjectView, f64)], pacer: &dyn Pacer) -> Result<Vec<f32>, ClipError> {
        let (seen, weights) = self.images_of_views(views, || pacer.before_step());
        let embeddings = self.network.embed_images_in_steps(&seen, pacer)?;
        Ok(weighted_mean(embeddings.iter().map(Vec::as_slice).zip(weights)))
    }

    /// The crops of views for the network, each with its weight. `before_view` is called before each.
    fn images_of_views(&self, views: &[(&ObjectView, f64)], before_view: impl Fn()) -> (Vec<Image<[u8; 3]>>, Vec<f64>) {
        let side = self.network.config().image_size;
        let (mut seen, mut weights) = (Vec::new(), Vec::new());
        for (view, weight) in views {
            before_view();
            let [whole, dimmed] = crops(view, side);
            if seen.is_empty() {
                seen.extend([whole, dimmed]);
                weights.extend([0.5 * weight; 2]);
            } else {
                seen.push(dimmed);
                weights.push(*weight);
            }
        }
        (seen, weights)
    }

    /// The embedding of a text, to be compared with those of objects.
    ///
    /// # Errors
    /// [`ClipError::NotFinite`].
    pub fn embed_text(&self, text: &str) -> Result<Vec<f32>, ClipError> {
        Ok(self.network.embed_texts(&[prompt(text)])?.remove(0))
    }

    /// Chooses labels for objects by their embeddings, all together: scores depend on the other objects of the map.
    ///
    /// # Errors
    /// [`ClipError::NotFinite`].
    pub fn choose_labels(&self, embeddings: &[&[f32]]) -> Result<Vec<ObjectName>, ClipError> {
        if embeddings.is_empty() {
            return Ok(Vec::new());
        }
        let words = self.word_embeddings()?;
        let best = |object: &[f32], words: &[Vec<f32>]| {
            words.iter().map(|word| dot(object, word)).fold(f32::NEG_INFINITY, f32::max)
        };
        let row = |object: &&[f32]| words.iter().map(|words| best(object, words)).collect();
        let similarities: Vec<Vec<f32>> = embeddings.iter().map(row).collect();
        let labels: Vec<&str> = self.vocabulary.labels().collect();
        let choice =
            LabelChoice { scale: f64::from(self.network.scale()), named: labels.len(), min_score: self.min_score };
        Ok(choice.names(&similarities, &labels))
    }

    /// Gives all objects that have an embedding of this network labels from the vocabulary.
    ///
    /// # Errors
    /// [`NamesError::Names`] if the embeddings have another length than the network's.
    pub fn label(&self, names: &mut ObjectNames) -> Result<(), NamesError> {
        let (ids, embeddings): (Vec<SegmentId>, Vec<&[f32]>) = names.embeddings().unzip();
        let expected = self.network.config().embedding;
        if let Some(other) = embeddings.iter().find(|embedding| embedding.len() != expected) {
            return Err(NameError::Length { found: expected, expected: other.len() }.into());
        }
        let labels = self.choose_labels(&embeddings)?;
        Ok(names.relabel(ids.into_iter().zip(labels))?)
    }

    /// How probable it is that an object is what a text says, rather than anything else, 0 to 1: for objects by their
    /// embeddings.
    ///
    /// # Errors
    /// [`ClipError::NotFinite`].
    pub fn fits(&self, text: &str, embeddings: &[&[f32]]) -> Result<Vec<f32>, ClipError> {
        let (query, anything) = (self.embed_text(text)?, self.anything()?);
        let mean: f32 =
            embeddings.iter().map(|object| dot(object, &query)).sum::<f32>() / embeddings.len().max(1) as f32;
        let share = embeddings.len() as f32 / (embeddings.len() as f32 + 8.0);
        let scale = self.network.scale();
        let fit = |object: &&[f32]| {
            let other = anything.iter().map(|word| dot(object, word)).fold(f32::NEG_INFINITY, f32::max);
            // With more objects, what counts is to be more similar than they are.
            let level = share * mean + (1.0 - share) * other.max(mean);
            1.0 / (1.0 + (-0.5 * scale * (dot(object, &query) - level)).exp())
        };
        Ok(embeddings.iter().map(fit).collect())
    }

    fn anything(&self) -> Result<Vec<Vec<f32>>, ClipError> {
        self.network.embed_texts(&ANYTHING.map(prompt))
    }

    /// The embeddings of the words of each label, then of those for anything, one by one.
    fn word_embeddings(&self) -> Result<&Vec<Vec<Vec<f32>>>, ClipError> {
        if let Some(known) = self.embeddings.get() {
            return Ok(known);
        }
        let embeddings = self.network.embed_texts(&self.prompts())?;
        Ok(self.embeddings.get_or_init(|| self.grouped(embeddings)))
    }

    /// Computes the words' embeddings, unless they are known, in steps of a few milliseconds.
    ///
    /// # Errors
    /// [`ClipError::NotFinite`].
    pub fn prepare_words_in_steps(&self, pacer: &dyn Pacer) -> Result<(), ClipError> {
        if self.embeddings.get().is_none() {
            let embeddings = self.network.embed_texts_in_steps(&self.prompts(), pacer)?;
            self.embeddings.get_or_init(|| self.grouped(embeddings));
        }
        Ok(())
    }

    /// The sentences of all words of the vocabulary, then of those for anything.
    fn prompts(&self) -> Vec<String> {
        let words = self.vocabulary.words().flatten().map(String::as_str);
        words.chain(ANYTHING).map(prompt).collect()
    }

    /// Embeddings of [`Self::prompts`] by label.
    fn grouped(&self, embeddings: Vec<Vec<f32>>) -> Vec<Vec<Vec<f32>>> {
        let mut embeddings = embeddings.into_iter();
        let of_labels = self.vocabulary.words().map(|words| embeddings.by_ref().take(words.len()).collect());
        let mut all: Vec<Vec<Vec<f32>>> = of_labels.collect();
        all.extend(embeddings.map(|word| vec![word]));
        all
    }
}

/// The sentence for a word, as in the captions that such networks were trained with.
fn prompt(word: &str) -> String {
    format!("a photo of a {word}")
}

fn dot(one: &[f32], other: &[f32]) -> f32 {
    one.iter().zip(other).map(|(one, other)| one * other).sum()
}

/// The weighted mean of vectors, with length 1; zeros without any.
fn weighted_mean<'a>(vectors: impl Iterator<Item = (&'a [f32], f64)>) -> Vec<f32> {
    let mut sum: Vec<f64> = Vec::new();
    for (vector, weight) in vectors {
        sum.resize(vector.len(), 0.0);
        sum.iter_mut().zip(vector).for_each(|(sum, value)| *sum += weight * f64::from(*value));
    }
    let length = sum.iter().map(|value| value * value).sum::<f64>().sqrt().max(1e-12);
    sum.iter().map(|value| (value / length) as f32).collect()
}
