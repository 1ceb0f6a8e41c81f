//! Parsed queries: a thing, a colour, a size.

/// Words for colours, with their sRGB.
const COLORS: [(&str, [u8; 3]); 22] = [
    ("red", [190, 30, 35]),
    ("orange", [235, 125, 30]),
    ("yellow", [235, 210, 50]),
    ("green", [50, 140, 60]),
    ("cyan", [60, 200, 210]),
    ("turquoise", [60, 190, 175]),
    ("blue", [40, 75, 180]),
    ("purple", [110, 50, 140]),
    ("violet", [120, 70, 170]),
    ("magenta", [200, 40, 140]),
    ("pink", [235, 150, 175]),
    ("brown", [110, 70, 40]),
    ("beige", [210, 190, 155]),
    ("tan", [195, 160, 115]),
    ("black", [30, 30, 30]),
    ("grey", [125, 125, 125]),
    ("gray", [125, 125, 125]),
    ("silver", [170, 170, 175]),
    ("white", [235, 235, 235]),
    ("golden", [200, 160, 60]),
    ("dark", [45, 45, 45]),
    ("bright", [215, 215, 215]),
];
const SMALL: [&str; 7] = ["small", "smaller", "smallest", "little", "tiny", "short", "low"];
const LARGE: [&str; 9] = ["large", "larger", "largest", "big", "bigger", "biggest", "huge", "tall", "high"];
/// Words that say nothing about which object is meant.
const FILLERS: [&str; 23] = [
    "a",
    "an",
    "the",
    "one",
    "ones",
    "thing",
    "things",
    "something",
    "object",
    "objects",
    "my",
    "our",
    "is",
    "are",
    "where",
    "find",
    "of",
    "that",
    "this",
    "some",
    "all",
    "coloured",
    "colored",
];

/// A size in a query.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum AskedSize {
    /// Small for its kind.
    Small,
    /// Large for its kind.
    Large,
}

/// A parsed query.
#[derive(Clone, Debug, PartialEq)]
pub struct Query {
    /// The whole text.
    pub text: String,
    /// The rest of the text without words for colour and size, in lower case; empty if there is none.
    pub thing: String,
    /// A colour, sRGB.
    pub color: Option<[u8; 3]>,
    /// A size.
    pub size: Option<AskedSize>,
}

impl Query {
    /// Reads a text, e.g. `the small red one` or `where is the mug?`.
    pub fn new(text: &str) -> Self {
        let (mut color, mut size, mut thing) = (None, None, Vec::new());
        let lower = text.to_lowercase();
        for word in words(&lower) {
            let own_color = COLORS.iter().find(|(name, _)| *name == word).map(|(_, rgb)| *rgb);
            if FILLERS.contains(&word) {
                continue;
            }
            if own_color.is_some() {
                color = color.or(own_color);
            } else if SMALL.contains(&word) {
                size = size.or(Some(AskedSize::Small));
            } else if LARGE.contains(&word) {
                size = size.or(Some(AskedSize::Large));
            } else {
                thing.push(word);
            }
        }
        Self { text: text.trim().to_owned(), thing: thing.join(" "), color, size }
    }

    /// True if the query wants one object, chosen by its size: `the smallest`, `largest box`.
    pub fn is_superlative(&self) -> bool {
        let text = self.text.to_lowercase();
        words(&text).any(|word| word.ends_with("est") && (SMALL.contains(&word) || LARGE.contains(&word)))
    }

    /// How well a colour fits the one in the query, 0 to 1; 1 if the query has none.
    pub(super) fn color_fit(&self, found: Option<[u8; 3]>) -> f32 {
        let Some(asked) = self.color else { return 1.0 };
        let Some(found) = found else { return 0.0 };
        let [nearest, own] = [nearest_color(lab(found)), color_distance(lab(found), lab(asked))];
        // An object is of the colour whose word fits it best, and somewhat of colours that are nearly as near.
        (-((own - nearest).max(0.0) / 12.0).powi(2)).exp()
    }
}

/// The words of a text.
fn words(text: &str) -> impl Iterator<Item = &str> {
    text.split(|character: char| !(character.is_alphanumeric() || "-'_".contains(character)))
        .filter(|word| !word.is_empty())
}

/// The word that fits an sRGB colour best, e.g. `red`.
pub fn color_word(color: [u8; 3]) -> &'static str {
    let distance = |rgb: [u8; 3]| color_distance(lab(color), lab(rgb));
    let nearest = COLORS.iter().min_by(|one, other| distance(one.1).total_cmp(&distance(other.1)));
    nearest.map_or("grey", |(word, _)| word)
}

/// Distance to the nearest colour that has a word.
fn nearest_color(color: [f32; 3]) -> f32 {
    COLORS.iter().map(|(_, rgb)| color_distance(color, lab(*rgb))).fold(f32::INFINITY, f32::min)
}

/// Distance of two colours, of which hue and chroma count more than lightness, which depends on the light.
fn color_distance(one: [f32; 3], other: [f32; 3]) -> f32 {
    let [lightness, a, b] = std::array::from_fn(|axis| one[axis] - other[axis]);
    ((0.5 * lightness).powi(2) + a * a + b * b).sqrt()
}

/// CIELAB of an sRGB colour.
fn lab(rgb: [u8; 3]) -> [f32; 3] {
    let linear = rgb.map(|channel| {
        let value = f32::from(channel) / 255.0;
        if value <= 0.040_45 { value / 12.92 } else { ((value + 0.055) / 1.055).powf(2.4) }
    });
    let [r, g, b] = linear;
    let xyz = [
        (0.4124 * r + 0.3576 * g + 0.1805 * b) / 0.9505,
        0.2126 * r + 0.7152 * g + 0.0722 * b,
        (0.0193 * r + 0.1192 * g + 0.9505 * b) / 1.089,
    ];
    let [x, y, z] = xyz.map(|value: f32| if value > 0.008_856 { value.cbrt() } else { 7.787 * value + 16.0 / 116.0 });
    [116.0 * y - 16.0, 500.0 * (x - y), 200.0 * (y - z)]
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn texts_are_taken_apart() {
        let query = Query::new("Where is the small RED coffee mug?");
        assert_eq!((query.thing.as_str(), query.size), ("coffee mug", Some(AskedSize::Small)));
        assert!(query.color.is_some());
        let query = Query::new("the big one");
        assert_eq!((query.thing.as_str(), query.size, query.color), ("", Some(AskedSize::Large), None));
        assert_eq!(Query::new("T-shirt").thing, "t-shirt");
        for text in ["the smallest", "Largest?", "the biggest, red one"] {
            assert!(Query::new(text).is_superlative(), "{text}");
        }
        for text in ["the large chest", "small forest", "the larger one"] {
            assert!(!Query::new(text).is_superlative(), "{text}");
        }
    }

    #[test]
    fn colours_fit_their_words() {
        let samples = [
            ("red", [160, 40, 45]),
            ("blue", [60, 90, 170]),
            ("green", [70, 120, 70]),
            ("white", [220, 222, 215]),
            ("black", [25, 28, 30]),
            ("brown", [100, 70, 50]),
            ("yellow", [220, 200, 70]),
        ];
        assert_eq!(
            ["red", "white", "brown"].map(|word| color_word(COLORS.iter().find(|(name, _)| *name == word).unwrap().1)),
            ["red", "white", "brown"]
        );
        for (word, _) in samples {
            let query = Query::new(word);
            let best = samples
                .iter()
                .max_by(|one, other| query.color_fit(Some(one.1)).total_cmp(&query.color_fit(Some(other.1))));
            assert_eq!(best.map(|best| best.0), Some(word));
            assert_eq!(query.color_fit(None), 0.0);
        }
        assert_eq!(Query::new("mug").color_fit(None), 1.0);
    }
}
