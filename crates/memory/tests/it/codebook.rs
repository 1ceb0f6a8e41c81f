//! The codebook: spacing of its vectors, and decoding of features to codes.

use proptest::prelude::*;
use splatseg_memory::{Codebook, CodebookError, CodebookSettings};
use std::sync::LazyLock;

fn settings(num_codes: usize, feature_dim: usize) -> CodebookSettings {
    CodebookSettings { num_codes, feature_dim, seed: 0 }
}

fn codebook(num_codes: usize, feature_dim: usize) -> Codebook {
    Codebook::generate(&settings(num_codes, feature_dim), &mut |_| ()).unwrap()
}

fn dot(left: &[f32], right: &[f32]) -> f32 {
    left.iter().zip(right).fold(0.0, |sum, (left, right)| sum + left * right)
}

/// Returns the smallest distance and largest inner product of all pairs, in double precision.
fn brute_force_spacing(codebook: &Codebook) -> (f64, f64) {
    let (mut distance, mut coherence) = (f64::INFINITY, -1.0f64);
    for i in 0..codebook.len() {
        for j in 0..i {
            let pairs =
                || codebook.vector(i).iter().zip(codebook.vector(j)).map(|(&a, &b)| (f64::from(a), f64::from(b)));
            distance = distance.min(pairs().map(|(a, b)| (a - b) * (a - b)).sum::<f64>().sqrt());
            coherence = coherence.max(pairs().map(|(a, b)| a * b).sum());
        }
    }
    (distance, coherence)
}

/// Decodes by comparing all codes.
fn brute_force_decode(codebook: &Codebook, feature: &[f32], used: usize, threshold: f32) -> Option<u32> {
    let mut best = None;
    let mut largest = f32::NEG_INFINITY;
    for index in 0..used.min(codebook.len()) {
        let product = dot(feature, codebook.vector(index));
        if product > largest {
            (best, largest) = (Some(index as u32), product);
        }
    }
    best.filter(|_| largest > threshold)
}

#[test]
fn codes_are_unit_vectors_as_far_apart_as_the_reference() {
    for (dim, reference) in [(28, 1.22), (14, 1.04), (7, 0.73), (4, 0.34)] {
        let codebook = codebook(512, dim);
        assert!(codebook.min_distance() >= reference, "D = {dim}: {}", codebook.min_distance());
        for index in 0..codebook.len() {
            assert!((dot(codebook.vector(index), codebook.vector(index)) - 1.0).abs() < 1e-5);
        }
        let (distance, coherence) = brute_force_spacing(&codebook);
        assert!((f64::from(codebook.min_distance()) - distance).abs() < 1e-5);
        assert!((f64::from(codebook.max_coherence()) - coherence).abs() < 1e-5);
    }
}

#[test]
fn few_codes_reach_the_known_optima() {
    // Simplices, and the cross-polytope, which has twice as many vertices as dimensions.
    for (count, dim, optimum) in [(2, 3, 2.0), (3, 2, 3f32.sqrt()), (4, 3, (8.0 / 3.0f32).sqrt()), (6, 3, 2f32.sqrt())]
    {
        let found = codebook(count, dim).min_distance();
        assert!((found - optimum).abs() < 0.01, "{count} codes in {dim} dimensions: {found}, not {optimum}");
    }
}

#[test]
fn codes_depend_on_settings_and_not_on_threads() {
    let bytes = |threads: usize| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        pool.install(|| {
            let mut codebook = codebook(130, 5);
            codebook.extend(33, &mut |_| ()).unwrap();
            codebook.vectors().iter().flat_map(|value| value.to_bits().to_le_bytes()).collect::<Vec<u8>>()
        })
    };
    assert_eq!(bytes(1), bytes(3));
    let other = Codebook::generate(&CodebookSettings { seed: 1, ..settings(130, 5) }, &mut |_| ()).unwrap();
    assert_ne!(codebook(130, 5), other);
}

#[test]
fn codes_are_the_same_on_every_platform() {
    // FNV-1a of all bits, computed on an x86-64 with AVX2.
    let codebook = codebook(64, 28);
    let bytes = codebook.vectors().iter().flat_map(|value| value.to_le_bytes());
    let hash =
        bytes.fold(0xcbf2_9ce4_8422_2325u64, |hash, byte| (hash ^ u64::from(byte)).wrapping_mul(0x100_0000_01b3));
    assert_eq!(hash, 0xfad7_341e_259a_f45f, "{hash:#018x}");
}

#[test]
fn extending_keeps_old_codes_and_spreads_new_ones() {
    let old = codebook(256, 14);
    let mut extended = old.clone();
    extended.extend(256, &mut |_| ()).unwrap();
    extended.extend(10, &mut |_| ()).unwrap();
    assert_eq!((extended.len(), extended.blocks()), (522, 3));
    assert_eq!(extended.vectors()[..old.vectors().len()], *old.vectors());
    let (distance, _) = brute_force_spacing(&extended);
    assert!((f64::from(extended.min_distance()) - distance).abs() < 1e-5);
    assert!(distance > 0.95, "{distance}");
    let mut again = old.clone();
    again.extend(256, &mut |_| ()).unwrap();
    again.extend(10, &mut |_| ()).unwrap();
    assert_eq!(again, extended);
    assert_ne!(again.vector(512), codebook(256, 14).vector(0), "blocks have random numbers of their own");
}

#[test]
fn progress_grows_to_one() {
    let mut heard = Vec::new();
    Codebook::generate(&settings(20, 3), &mut |fraction| heard.push(fraction)).unwrap();
    assert!(heard.is_sorted() && heard[0] > 0.0 && *heard.last().unwrap() == 1.0, "{heard:?}");
    let mut heard = Vec::new();
    Codebook::generate(&settings(1, 3), &mut |fraction| heard.push(fraction)).unwrap();
    assert_eq!(heard, [1.0]);
}

#[test]
fn integer_ids() {
    let mut codebook = codebook(300, 1);
    assert_eq!((codebook.vector(0), codebook.vector(299)), (&[1.0][..], &[300.0][..]));
    codebook.extend(2, &mut |_| ()).unwrap();
    assert_eq!((codebook.vector(301), codebook.min_distance(), codebook.max_coherence()), (&[302.0][..], 1.0, 1.0));
    let cases = [(0.0, None), (0.4, None), (0.6, Some(0)), (1.4, Some(0)), (99.6, Some(99)), (100.6, None)];
    for (value, expected) in cases.into_iter().chain([(-3.0, None), (f32::NAN, None), (f32::INFINITY, None)]) {
        assert_eq!(codebook.decode(&[value], 100, 0.5), expected, "{value}");
        assert_eq!(codebook.decode_with_hint(&[value], Some(7), 100, 0.5), expected, "{value}");
    }
}

#[test]
fn odd_sizes_work() {
    for (count, dim) in [(1, 1), (1, 2), (1, 28), (2, 1), (2, 2), (3, 17), (17, 16), (33, 33), (5, 300)] {
        let codebook = codebook(count, dim);
        assert_eq!((codebook.len(), codebook.feature_dim(), codebook.is_empty()), (count, dim, false));
        for index in 0..count {
            assert_eq!(codebook.decode(codebook.vector(index), count, 0.5), Some(index as u32));
        }
    }
    for dim in [1, 4] {
        assert_eq!((codebook(1, dim).min_distance(), codebook(1, dim).max_coherence()), (f32::INFINITY, -1.0));
    }
}

#[test]
fn impossible_sizes_are_errors() {
    let error = |count, dim| Codebook::generate(&settings(count, dim), &mut |_| ()).unwrap_err();
    assert_eq!(error(0, 28), CodebookError::NoCodes);
    assert_eq!(error(8, 0), CodebookError::FeatureDim { found: 0 });
    assert_eq!(error(8, usize::MAX), CodebookError::FeatureDim { found: usize::MAX });
    assert!(matches!(error(usize::MAX, 28), CodebookError::TooManyCodes { found: usize::MAX, .. }));
    assert!(matches!(error(1 << 25, 1), CodebookError::TooManyCodes { .. }));
    // 2^28 values.
    assert_eq!(error(4097, 1 << 16), CodebookError::TooManyCodes { found: 4097, max: 4096, feature_dim: 1 << 16 });
    let mut codebook = codebook(4, 2);
    let before = codebook.clone();
    assert_eq!(codebook.extend(0, &mut |_| ()), Err(CodebookError::NoCodes));
    assert!(matches!(codebook.extend(usize::MAX, &mut |_| ()), Err(CodebookError::TooManyCodes { .. })));
    assert_eq!(codebook, before);
}

#[test]
fn settings_refuse_unknown_fields() {
    let settings: CodebookSettings = toml::from_str("feature_dim = 7").unwrap();
    assert_eq!(settings, CodebookSettings { num_codes: 512, feature_dim: 7, seed: 0 });
    assert!(toml::from_str::<CodebookSettings>("features = 7").is_err());
}

#[test]
fn features_without_a_code_decode_to_none() {
    let codebook = codebook(40, 7);
    let first = codebook.vector(0).to_vec();
    assert_eq!(codebook.decode(&[0.0; 7], 40, 0.5), None);
    assert_eq!(codebook.decode(&[f32::NAN; 7], 40, 0.5), None);
    assert_eq!(codebook.decode(&[f32::INFINITY; 7], 40, 0.5), None);
    assert_eq!(codebook.decode(&first, 0, 0.5), None);
    assert_eq!(codebook.decode(&first, usize::MAX, 0.5), Some(0));
    assert_eq!(codebook.decode(&first[..6], 40, 0.5), None);
    assert_eq!(codebook.decode(&[first.clone(), vec![0.0]].concat(), 40, 0.5), None);
    assert_eq!(codebook.decode_with_hint(&first, Some(u32::MAX), 40, 0.5), Some(0));
    assert_eq!(
        codebook.decode_with_hint(codebook.vector(9), Some(9), 9, 0.5),
        codebook.decode(codebook.vector(9), 9, 0.5)
    );
}

static CODEBOOKS: LazyLock<Vec<Codebook>> =
    LazyLock::new(|| [2, 3, 4, 7, 14, 28].into_iter().map(|dim| codebook(100, dim)).collect());

/// A mixture of two codes with noise and any length, as rendering produces.
fn arbitrary_feature() -> impl Strategy<Value = (usize, usize, usize, Vec<f32>)> {
    let codes = (0..6usize, 0..100usize, 0..100usize, 0.0..=1.0f32);
    let length =
        prop_oneof![Just(1.0f32), 0.0..2.0f32, 0.49..0.51f32, Just(1e-15), Just(1e-30), Just(1e15), Just(1e30)];
    let noise = prop_oneof![Just(0.0f32), Just(1e-7), Just(1e-5), 0.0..0.5f32, Just(2.0)];
    (codes, length, noise, proptest::collection::vec(-1.0..1.0f32, 28)).prop_map(|(codes, length, noise, offsets)| {
        let (book, first, second, share) = codes;
        let codebook = &CODEBOOKS[book];
        let pairs = codebook.vector(first).iter().zip(codebook.vector(second)).zip(offsets);
        let mixed = pairs.map(|((a, b), offset)| (a * share + b * (1.0 - share) + offset * noise) * length).collect();
        (book, first, second, mixed)
    })
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 20_000, failure_persistence: None, ..ProptestConfig::default() })]

    #[test]
    fn hints_change_nothing(
        (book, first, second, feature) in arbitrary_feature(),
        used in 0..110usize,
        threshold in prop_oneof![Just(0.5f32), -1.0..2.0f32, Just(0.0), Just(1e-20)],
        wild in any::<u32>(),
    ) {
        let codebook = &CODEBOOKS[book];
        let expected = brute_force_decode(codebook, &feature, used, threshold);
        prop_assert_eq!(codebook.decode(&feature, used, threshold), expected);
        for hint in [first as u32, second as u32, wild % 100, wild] {
            prop_assert_eq!(codebook.decode_with_hint(&feature, Some(hint), used, threshold), expected);
        }
    }
}
