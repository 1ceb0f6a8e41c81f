//! CLIP's tokenizer: texts, merges, and files of labels.
#![no_main]

use libfuzzer_sys::fuzz_target;
use splatseg::names::Vocabulary;
use splatseg_models::clip::ClipTokenizer;

fuzz_target!(|bytes: &[u8]| {
    let text = String::from_utf8_lossy(bytes);
    let tokens = ClipTokenizer::built_in().tokens(&text, 77);
    assert!((2..=77).contains(&tokens.len()) && tokens.iter().all(|token| *token < 49408));
    if let Ok(tokenizer) = ClipTokenizer::from_merges(&text) {
        tokenizer.tokens("lower aber ab", 16);
    }
    let _ = Vocabulary::of(text.lines().map(str::to_owned));
});
