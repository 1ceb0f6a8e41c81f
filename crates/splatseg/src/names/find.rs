//! Objects found by words: labels, pictures, colours and sizes, through one function.

use super::clip_names::{ClipNames, NamesError};
use super::query::{AskedSize, Query};
use super::vocabulary::Vocabulary;
use serde::Serialize;
use splatseg_geometry::SegmentId;
use splatseg_objects::{LabelScore, NameError, Object, ObjectList, ObjectNames};

/// Objects whose score is less than this share of the best are left out.
const MIN_SHARE: f32 = 0.25;
/// Least score of an object.
const MIN_SCORE: f32 = 0.05;
/// Score of a label that only contains the words of the text, or is an alternative.
const PART_OF_LABEL: f32 = 0.8;
const ALTERNATIVE: f32 = 0.5;
/// A plural that [`with_singulars`] knows is at most this much longer than its singular, bytes.
const LONGER_PLURAL: usize = 2;

/// An object that fits a text.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct FoundObject {
    /// Its id.
    pub id: SegmentId,
    /// Its label, if it has one.
    pub label: Option<String>,
    /// How well it fits, 0 to 1.
    pub score: f32,
    /// Which of its properties fit: `label`, `picture`, `color`, `size`.
    pub by: Vec<&'static str>,
}

/// Finds the objects that fit a text, best first, equally good ones by id. Labels, their synonyms in the built-in
/// vocabulary, colour words and words for size need no network. With one, objects with an embedding are also compared with
/// the text, whatever their labels. Only objects that count are found
/// ([`Object::counts`]); see also [`ObjectList::with_tentative`].
///
/// # Errors
/// [`NamesError`] if the embeddings are of another network.
pub fn find_objects(
    query: &Query,
    list: &ObjectList,
    names: &ObjectNames,
    network: Option<&ClipNames>,
) -> Result<Vec<FoundObject>, NamesError> {
    let mut found: Vec<(FoundObject, &Object)> = list
        .objects
        .iter()
        .map(|object| {
            let (score, by) = (1.0, Vec::new());
            (FoundObject { id: object.id, label: object.label.clone(), score, by }, object)
        })
        .collect();
    if !query.thing.is_empty() {
        let synonyms = Synonyms::new(&query.thing, network.map(ClipNames::vocabulary));
        let pictures = picture_fits(query, &found, names, network)?;
        for ((found, object), picture) in found.iter_mut().zip(pictures) {
            let label = synonyms.fit(object);
            found.score = label.max(picture);
            found.by.extend((label > 0.0).then_some("label"));
            found.by.extend((picture > label).then_some("picture"));
        }
    }
    if query.color.is_some() {
        for (found, object) in &mut found {
            found.score *= query.color_fit(object.color);
            found.by.push("color");
        }
    }
    // A label may have words for colours and sizes in it.
    let whole = Synonyms::new(&query.text.to_lowercase(), network.map(ClipNames::vocabulary));
    for (found, object) in &mut found {
        let label = object.label.as_deref().map_or(0.0, |label| whole.fit_label(label));
        if label > found.score || label >= 1.0 {
            (found.score, found.by) = (label, vec!["label"]);
        }
    }
    found.retain(|(found, _)| found.score >= MIN_SCORE);
    if let Some(size) = query.size {
        rank_by_size(&mut found, size);
    }
    let mut found: Vec<FoundObject> = found.into_iter().map(|(found, _)| found).collect();
    found.sort_by(|one, other| other.score.total_cmp(&one.score).then(one.id.cmp(&other.id)));
    let best = found.first().map_or(0.0, |best| best.score);
    found.retain(|found| found.score >= MIN_SHARE * best);
    Ok(found)
}

/// How well the picture of each object fits the text; 0 without a network or embedding.
fn picture_fits(
    query: &Query,
    found: &[(FoundObject, &Object)],
    names: &ObjectNames,
    network: Option<&ClipNames>,
) -> Result<Vec<f32>, NamesError> {
    let mut fits = vec![0.0; found.len()];
    let Some(network) = network else { return Ok(fits) };
    let expected = network.network().config().embedding;
    let embedded: Vec<(usize, &[f32])> = found.iter().map(|(found, _)| names.embedding(found.id)).enumerate().collect();
    let embedded: Vec<(usize, &[f32])> = embedded.into_iter().filter(|(_, embedding)| !embedding.is_empty()).collect();
    if let Some((_, other)) = embedded.iter().find(|(_, embedding)| embedding.len() != expected) {
        return Err(NameError::Length { found: expected, expected: other.len() }.into());
    }
    let embeddings: Vec<&[f32]> = embedded.iter().map(|(_, embedding)| *embedding).collect();
    for ((index, _), fit) in embedded.iter().zip(network.fits(&query.thing, &embeddings)?) {
        fits[*index] = fit;
    }
    Ok(fits)
}

/// The smallest or largest of the objects comes first: their scores fall with their place in that order.
fn rank_by_size(found: &mut [(FoundObject, &Object)], size: AskedSize) {
    let volume = |object: &Object| {
        object.shape.as_ref().map(|shape| {
            let [x, y, z] = shape.oriented_box.size.to_array().map(|side| f64::from(side).max(0.01));
            x * y * z
        })
    };
    let mut order: Vec<usize> = (0..found.len()).collect();
    order.sort_by(|one, other| {
        let [one, other] = [one, other].map(|index| volume(found[*index].1));
        let by_size = one.unwrap_or(f64::INFINITY).total_cmp(&other.unwrap_or(f64::INFINITY));
        if size == AskedSize::Small { by_size } else { by_size.reverse() }
    });
    // An object without a shape has no size, so it comes last in either order.
    order.sort_by_key(|index| volume(found[*index].1).is_none());
    let count = order.len() as f32;
    for (place, index) in order.into_iter().enumerate() {
        let found = &mut found[index].0;
        found.score *= 1.0 - 0.75 * place as f32 / count.max(1.0);
        found.by.push("size");
    }
}

/// A text and the labels for which it stands.
struct Synonyms {
    /// The text, then what it may be the plural of.
    words: Vec<String>,
    labels: Vec<String>,
}

impl Synonyms {
    fn new(thing: &str, own: Option<&Vocabulary>) -> Self {
        let built_in = Vocabulary::built_in();
        let words = with_singulars(thing);
        let vocabularies = own.into_iter().chain([&built_in]);
        let of = |vocabulary: &Vocabulary| -> Vec<String> {
            words.iter().flat_map(|word| vocabulary.labels_of(word)).map(str::to_lowercase).collect()
        };
        let labels = vocabularies.flat_map(of).collect();
        Self { words, labels }
    }

    /// How well the labels of an object fit, 0 to 1.
    fn fit(&self, object: &Object) -> f32 {
        let own = object.label.as_deref().map_or(0.0, |label| self.fit_label(label));
        let other = |other: &LabelScore| ALTERNATIVE * self.fit_label(&other.label);
        object.label_alternatives.iter().map(other).fold(own, f32::max)
    }

    /// True if a label contains the words of the text, a plural of them, or a singular. A word within another one, such as
    /// `cup` in `cupboard`, is another thing.
    fn is_part_of(&self, label: &str) -> bool {
        let Some((text, singulars)) = self.words.split_first().filter(|(text, _)| !text.is_empty()) else {
            return false;
        };
        parts(label, text.len() + LONGER_PLURAL)
            .any(|part| singulars.iter().any(|word| word == part) || with_singulars(part).contains(text))
    }

    fn fit_label(&self, label: &str) -> f32 {
        let label = label.to_lowercase();
        if self.words.contains(&label) || self.labels.contains(&label) {
            1.0
        } else if self.is_part_of(&label) {
            PART_OF_LABEL
        } else {
            0.0
        }
    }
}

/// The parts of a label of at most `longest` bytes that begin and end with a word.
fn parts(label: &str, longest: usize) -> impl Iterator<Item = &str> {
    let ends: Vec<usize> = (0..=label.len()).filter(|place| is_word_boundary(label, *place)).collect();
    let starts = ends.clone();
    starts.into_iter().flat_map(move |start| {
        let after = ends.iter().copied().filter(move |end| *end > start && *end - start <= longest);
        after.map(|end| &label[start..end]).collect::<Vec<_>>()
    })
}

/// True if a word may begin or end at a byte position of a text: the character on one side is not a letter or digit, or
/// belongs to a script that does not separate words.
fn is_word_boundary(text: &str, place: usize) -> bool {
    let Some((before, after)) = text.split_at_checked(place) else { return false };
    let is_inside = |character: char| character.is_alphanumeric() && !is_unseparated(character);
    let both = before.chars().next_back().zip(after.chars().next());
    both.is_none_or(|(before, after)| !is_inside(before) || !is_inside(after))
}

/// True of letters of scripts without spaces between words: Thai to Lao, Burmese, Khmer, Japanese and Chinese.
fn is_unseparated(character: char) -> bool {
    matches!(character, '\u{e00}'..='\u{eff}' | '\u{1000}'..='\u{109f}' | '\u{1780}'..='\u{17ff}'
        | '\u{3040}'..='\u{30ff}' | '\u{3400}'..='\u{9fff}' | '\u{f900}'..='\u{faff}' | '\u{20000}'..='\u{3ffff}')
}

/// A text and the words whose plural it may be: `boxes`, `shelves`, `mugs`, `batteries`.
fn with_singulars(text: &str) -> Vec<String> {
    let endings = [("s", ""), ("es", ""), ("ies", "y"), ("ves", "f"), ("ves", "fe")];
    let singular = |(plural, singular): (&str, &str)| {
        let stem = text.strip_suffix(plural).filter(|stem| stem.len() > 1)?;
        Some(format!("{stem}{singular}"))
    };
    std::iter::once(text.to_owned()).chain(endings.into_iter().filter_map(singular)).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_text_is_part_of_a_label_as_words() {
        let is_part = |text: &str, label: &str| Synonyms::new(text, None).is_part_of(label);
        for (text, label) in [
            ("cup", "coffee cup"),
            ("cup", "cup, blue"),
            ("cup", "cup-holder"),
            ("cup", "my mother's cups"),
            ("mother", "my mother's cups"),
            ("box", "toy boxes"),
            ("shelf", "two shelves"),
            ("boxes", "box of toys"),
            ("coffee cups", "a blue coffee cup"),
            ("table", "table_2"),
            ("stühle", "rote stühle"),
            ("стол", "стол у окна"),
            ("\u{676f}\u{5b50}", "\u{7ea2}\u{8272}\u{7684}\u{676f}\u{5b50}"),
        ] {
            assert!(is_part(text, label), "{text} in {label}");
        }
        for (text, label) in [
            ("cup", "cupboard"),
            ("car", "carpet"),
            ("car", "red carpets"),
            ("pot", "flowerpot"),
            ("tab", "table_2"),
            ("hl", "rote stühle"),
            ("стол", "столовая"),
            ("cups of", "cup"),
            ("", "cup"),
        ] {
            assert!(!is_part(text, label), "{text} in {label}");
        }
    }
}
