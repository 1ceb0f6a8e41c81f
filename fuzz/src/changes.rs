//! Random changes of files, the same on every machine.

/// Most places of a file that are changed.
const MAX_CHANGES: u64 = 8;
/// Numbers at which readers go wrong, if anywhere.
const NUMBERS: [u64; 12] =
    [0, 1, 0x7F, 0x80, 0xFF, 0x7FFF, 0x8000, 0xFFFF, 0x7FFF_FFFF, 0x8000_0000, 0xFFFF_FFFF, u64::MAX];

/// A generator of numbers (SplitMix64): the same on every machine.
pub struct Random(pub u64);

impl Random {
    /// The next number.
    #[allow(clippy::should_implement_trait, reason = "it never ends")]
    pub fn next(&mut self) -> u64 {
        self.0 = self.0.wrapping_add(0x9E37_79B9_7F4A_7C15);
        let mixed = (self.0 ^ (self.0 >> 30)).wrapping_mul(0xBF58_476D_1CE4_E5B9);
        let mixed = (mixed ^ (mixed >> 27)).wrapping_mul(0x94D0_49BB_1331_11EB);
        mixed ^ (mixed >> 31)
    }

    /// A number below `end`; 0 if that is 0.
    pub fn below(&mut self, end: usize) -> usize {
        (self.next() % end.max(1) as u64) as usize
    }
}

/// Changes bytes in one way.
fn change(bytes: &mut Vec<u8>, random: &mut Random) {
    let at = random.below(bytes.len());
    let length = 1 + random.below(32).min(bytes.len().saturating_sub(at));
    let end = (at + length).min(bytes.len());
    match random.below(8) {
        _ if bytes.is_empty() => bytes.push(random.next() as u8),
        0 => bytes[at] ^= 1 << random.below(8),
        1 => bytes[at] = random.next() as u8,
        2 | 3 => {
            let number = NUMBERS[random.below(NUMBERS.len())];
            let width = 1 << random.below(4);
            let digits = if random.below(2) == 0 { number.to_le_bytes() } else { number.to_be_bytes() };
            let digits = if digits[0] == 0 && number > 0 { &digits[8 - width..] } else { &digits[..width] };
            bytes.iter_mut().skip(at).zip(digits).for_each(|(byte, digit)| *byte = *digit);
        }
        4 => _ = bytes.drain(at..end),
        5 => {
            let part = bytes[at..end].to_vec();
            let to = random.below(bytes.len());
            bytes.splice(to..to, part);
        }
        6 => {
            let digits = [&b"-1"[..], b"1e99", b"nan", b"99999999999", b"\"", b"\0", b"\n", b"{"][random.below(8)];
            bytes.splice(at..at, digits.iter().copied());
        }
        _ if random.below(4) == 0 => bytes.truncate(at),
        _ => {
            let from = random.below(bytes.len());
            let part: Vec<u8> = bytes[from..].iter().copied().take(end - at).collect();
            bytes.iter_mut().skip(at).zip(part).for_each(|(byte, other)| *byte = other);
        }
    }
}

/// Changes bytes in up to eight places.
pub fn change_places(bytes: &mut Vec<u8>, random: &mut Random) {
    for _ in 0..=random.next() % MAX_CHANGES {
        change(bytes, random);
    }
}
