//! CLIP's tokenizer: byte-pair encoding of words in lower case. Its 48,894 merges are built in (`merges.txt.gz`, from
//! github.com/openai/CLIP, MIT License, Copyright (c) 2021 OpenAI).
//!
//! Texts are used as they are, but for space and curly quotes: HTML entities are not replaced, nor are wrongly decoded
//! characters repaired, as OpenCLIP does with `ftfy`.

use flate2::read::GzDecoder;
use regex_syntax::hir::{Class, HirKind};
use std::collections::HashMap;
use std::io::Read as _;
use std::sync::{Arc, OnceLock};
use thiserror::Error;

static MERGES: &[u8] = include_bytes!("merges.txt.gz");

/// Maximum length of a text that is looked at, bytes: far more than any context holds.
const MAX_TEXT_BYTES: usize = 1 << 14;
const START: u32 = 49406;
const END: u32 = 49407;
/// Endings that are tokens of their own.
const ENDINGS: [&str; 7] = ["'s", "'t", "'re", "'ve", "'m", "'ll", "'d"];

/// Merges that cannot be used.
#[derive(Clone, Debug, PartialEq, Eq, Error)]
#[error("line {line} of the merges: found {found:?}, expected two known tokens")]
pub struct TokenizerError {
    /// The line, from 1.
    pub line: usize,
    /// Its start.
    pub found: String,
}

/// CLIP's tokenizer.
#[derive(Clone, Debug)]
pub struct ClipTokenizer(Arc<Merges>);

#[derive(Debug)]
struct Merges {
    /// The token of each byte, within a word.
    bytes: [u32; 256],
    /// The token that a pair of tokens becomes. Earlier merges have smaller tokens.
    pairs: HashMap<(u32, u32), u32>,
    letters: Letters,
}

impl ClipTokenizer {
    /// Number of tokens.
    pub const TOKENS: usize = 49408;

    /// The tokenizer of CLIP.
    pub fn built_in() -> Self {
        static TOKENIZER: OnceLock<ClipTokenizer> = OnceLock::new();
        let read = || {
            let mut text = String::new();
            // The file is part of the program, and a test reads it.
            GzDecoder::new(MERGES).read_to_string(&mut text).expect("the built-in merges can be unpacked");
            Self::from_merges(&text).expect("the built-in merges are CLIP's")
        };
        TOKENIZER.get_or_init(read).clone()
    }

    /// A tokenizer from merges, one pair of tokens in each line, most frequent first; tokens are written as in GPT-2's
    /// vocabulary, with `</w>` at the end of a word.
    ///
    /// # Errors
    /// If a line is not a pair of tokens that bytes and the lines before it make.
    pub fn from_merges(text: &str) -> Result<Self, TokenizerError> {
        let alphabet = byte_characters();
        let mut bytes = [0; 256];
        let mut tokens = HashMap::new();
        for (token, (byte, character)) in alphabet.into_iter().enumerate() {
            bytes[usize::from(byte)] = token as u32;
            tokens.insert(character.to_string(), token as u32);
            tokens.insert(format!("{character}</w>"), token as u32 + 256);
        }
        let mut pairs = HashMap::new();
        for (index, line) in text.lines().enumerate() {
            let wrong = || TokenizerError { line: index + 1, found: line.chars().take(40).collect() };
            let (first, second) = line.split_once(' ').ok_or_else(wrong)?;
            let pair = (*tokens.get(first).ok_or_else(wrong)?, *tokens.get(second).ok_or_else(wrong)?);
            let token = 512 + index as u32;
            pairs.insert(pair, token);
            tokens.insert(format!("{first}{second}"), token);
        }
        Ok(Self(Arc::new(Merges { bytes, pairs, letters: Letters::new() })))
    }

    /// The tokens of a text between those for start and end, at most `context` in all.
    pub fn tokens(&self, text: &str, context: usize) -> Vec<u32> {
        let text = cleaned(text);
        let mut tokens = vec![START];
        for word in self.0.letters.words(&text) {
            if tokens.len() + 1 >= context {
                break;
            }
            match word {
                "<start_of_text>" => tokens.push(START),
                "<end_of_text>" => tokens.push(END),
                word => self.0.push_word(word, &mut tokens),
            }
        }
        tokens.truncate(context.saturating_sub(1).max(1));
        tokens.push(END);
        tokens
    }
}

impl Merges {
    /// Adds the tokens of a word: its bytes, merged pair by pair, the most frequent pair first.
    fn push_word(&self, word: &str, tokens: &mut Vec<u32>) {
        let mut parts: Vec<u32> = word.bytes().map(|byte| self.bytes[usize::from(byte)]).collect();
        if let Some(last) = parts.last_mut() {
            *last += 256;
        }
        loop {
            let merged = parts.windows(2).filter_map(|pair| self.pairs.get(&(pair[0], pair[1])).map(|to| (*to, pair)));
            let Some((to, [first, second])) =
                merged.min_by_key(|(to, _)| *to).map(|(to, pair)| (to, [pair[0], pair[1]]))
            else {
                break;
            };
            let mut at = 0;
            let mut next = Vec::with_capacity(parts.len());
            while at < parts.len() {
                if parts[at] == first && parts.get(at + 1) == Some(&second) {
                    next.push(to);
                    at += 2;
                } else {
                    next.push(parts[at]);
                    at += 1;
                }
            }
            parts = next;
        }
        tokens.extend(parts);
    }
}

/// The text in lower case, with single spaces and straight quotes.
fn cleaned(text: &str) -> String {
    let mut end = text.len().min(MAX_TEXT_BYTES);
    while !text.is_char_boundary(end) {
        end -= 1;
    }
    let straight = |character: char| match character {
        '\u{2018}' | '\u{2019}' | '\u{201b}' => '\'',
        '\u{201c}' | '\u{201d}' | '\u{201f}' => '"',
        other => other,
    };
    let words: Vec<&str> = text[..end].split_whitespace().collect();
    words.join(" ").chars().map(straight).collect::<String>().to_lowercase()
}

/// The bytes with the characters that stand for them in GPT-2's vocabulary, in the order of their tokens.
fn byte_characters() -> Vec<(u8, char)> {
    let shown: Vec<u8> = (b'!'..=b'~').chain(0xa1..=0xac).chain(0xae..=0xff).collect();
    let others = (0..=255).filter(|byte| !shown.contains(byte));
    let others = others.zip(256u32..).map(|(byte, code)| (byte, char::from_u32(code).unwrap_or_default()));
    shown.iter().map(|byte| (*byte, char::from(*byte))).chain(others).collect()
}

/// Unicode's letters, as ranges.
#[derive(Debug)]
struct Letters(Vec<(char, char)>);

/// Kind of a character.
#[derive(Clone, Copy, PartialEq, Eq)]
enum Kind {
    Space,
    Letter,
    Number,
    Other,
}

impl Letters {
    fn new() -> Self {
        let parsed = regex_syntax::Parser::new().parse(r"\p{L}");
        let ranges = match parsed.map(regex_syntax::hir::Hir::into_kind) {
            Ok(HirKind::Class(Class::Unicode(class))) => {
                class.ranges().iter().map(|range| (range.start(), range.end())).collect()
            }
            _ => Vec::new(),
        };
        Self(ranges)
    }

    fn kind(&self, character: char) -> Kind {
        let is_letter = || {
            let place = self.0.partition_point(|(_, end)| *end < character);
            self.0.get(place).is_some_and(|(start, _)| *start <= character)
        };
        if character.is_whitespace() {
            Kind::Space
        } else if is_letter() {
            Kind::Letter
        } else if character.is_numeric() {
            Kind::Number
        } else {
            Kind::Other
        }
    }

    /// Splits a text: letters, single digits, and runs of other characters; the endings of English verbs and nouns; the
    /// names of the two special tokens.
    fn words<'a>(&'a self, text: &'a str) -> impl Iterator<Item = &'a str> {
        let mut rest = text;
        std::iter::from_fn(move || {
            rest = rest.trim_start();
            let first = rest.chars().next()?;
            let special = ["<start_of_text>", "<end_of_text>"].into_iter().chain(ENDINGS);
            let kind = self.kind(first);
            let end = special.map(|word| rest.starts_with(word).then_some(word.len())).find_map(|length| length);
            let end = end.unwrap_or_else(|| match kind {
                Kind::Number => first.len_utf8(),
                kind => {
                    rest.char_indices().find(|(_, other)| self.kind(*other) != kind).map_or(rest.len(), |(at, _)| at)
                }
            });
            let (word, after) = rest.split_at(end);
            rest = after;
            Some(word)
        })
    }
}
