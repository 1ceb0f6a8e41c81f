//! Cache of codes on disk, so that later runs with a codebook start at once.
//!
//! Each block of codes has a file, in `$SPLATSEG_CACHE` if that is set (empty: no cache), else in `splatseg` in the
//! user's cache folder. Its name and its header contain all inputs of the codes. A damaged file is replaced. A cache
//! that cannot be written is ignored.

use std::io;
use std::path::{Path, PathBuf};

/// First bytes of a file. Increase the number with every change that changes codes.
const MAGIC: &[u8] = b"splatseg codes 1\n";
/// Minimum work to generate codes for caching them, in dimensions of inner products: about 20 ms.
const MIN_WORK: usize = 1 << 30;

/// The cache folder.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub(crate) struct CodebookCache {
    folder: Option<PathBuf>,
}

/// All inputs of a block of codes.
#[derive(Clone, Copy, Debug)]
pub(super) struct BlockKey<'a> {
    /// Codes of earlier blocks, row-major.
    pub earlier: &'a [f32],
    pub feature_dim: usize,
    /// Number of codes in the block.
    pub count: usize,
    pub seed: u64,
    pub block: u32,
}

impl CodebookCache {
    /// The user's cache.
    pub fn of_user() -> Self {
        let folder = |name: &str| std::env::var_os(name).map(PathBuf::from);
        // Relative paths are ignored, as the XDG base directory specification requires.
        let absolute = |name: &str| folder(name).filter(|path| path.is_absolute());
        let folder = match folder("SPLATSEG_CACHE") {
            Some(path) => Some(path).filter(|path| !path.as_os_str().is_empty()),
            None if cfg!(windows) => absolute("LOCALAPPDATA").map(|path| path.join("splatseg")),
            None => absolute("XDG_CACHE_HOME")
                .or_else(|| absolute("HOME").map(|home| home.join(".cache")))
                .map(|path| path.join("splatseg")),
        };
        Self { folder }
    }

    /// A cache in a folder, which may not exist yet.
    #[cfg(test)]
    pub fn in_folder(folder: &Path) -> Self {
        Self { folder: Some(folder.to_owned()) }
    }

    /// Loads the block's codes; `None` if the file is missing or damaged.
    pub(super) fn load(&self, key: &BlockKey<'_>) -> Option<Vec<f32>> {
        let path = self.path(key)?;
        match read(&path, key) {
            Ok(codes) => Some(codes),
            Err(error) if error.kind() == io::ErrorKind::NotFound => None,
            Err(error) => {
                tracing::debug!("{}: {error}: generating the codes again", path.display());
                None
            }
        }
    }

    /// Saves the block's codes.
    pub(super) fn store(&self, key: &BlockKey<'_>, codes: &[f32]) {
        let Some(path) = self.path(key) else { return };
        let written = path.parent().map_or(Ok(()), std::fs::create_dir_all);
        let written = written.and_then(|()| splatseg_files::write_atomically(&path, &file(key, codes)));
        if let Err(error) = written {
            tracing::debug!("{}: {error}: the codes are not cached", path.display());
        }
    }

    /// Path of the block's file; `None` without a cache, or if the codes take too little work to cache.
    fn path(&self, key: &BlockKey<'_>) -> Option<PathBuf> {
        let all = key.count.saturating_add(key.earlier.len() / key.feature_dim.max(1));
        let work = super::repulsion::work(key.count, all, key.feature_dim);
        let folder = self.folder.as_ref().filter(|_| work >= MIN_WORK)?;
        let hash = key
            .header()
            .iter()
            .fold(0xcbf2_9ce4_8422_2325u64, |hash, byte| (hash ^ u64::from(*byte)).wrapping_mul(0x100_0000_01b3));
        Some(folder.join(format!("codes-{}x{}-{hash:016x}.bin", key.count, key.feature_dim)))
    }
}

impl BlockKey<'_> {
    fn header(&self) -> Vec<u8> {
        let mut checksum = crc32fast::Hasher::new();
        self.earlier.iter().for_each(|value| checksum.update(&value.to_le_bytes()));
        let numbers =
            [self.feature_dim as u64, self.count as u64, self.seed, self.block.into(), self.earlier.len() as u64];
        let numbers = numbers.into_iter().chain([checksum.finalize().into()]).flat_map(u64::to_le_bytes);
        MAGIC.iter().copied().chain(numbers).collect()
    }
}

/// Returns the whole file: header, codes, CRC-32 of both.
fn file(key: &BlockKey<'_>, codes: &[f32]) -> Vec<u8> {
    let mut bytes = key.header();
    bytes.extend(codes.iter().flat_map(|value| value.to_le_bytes()));
    bytes.extend(crc32fast::hash(&bytes).to_le_bytes());
    bytes
}

fn read(path: &Path, key: &BlockKey<'_>) -> io::Result<Vec<f32>> {
    let damaged = |what: &str| io::Error::new(io::ErrorKind::InvalidData, what);
    let header = key.header();
    let length = header.len() + key.count * key.feature_dim * size_of::<f32>() + size_of::<u32>();
    let bytes = splatseg_files::read_file(path, length as u64)?;
    let (content, checksum) = bytes.split_last_chunk().ok_or_else(|| damaged("too short"))?;
    if bytes.len() != length || u32::from_le_bytes(*checksum) != crc32fast::hash(content) {
        return Err(damaged("damaged"));
    }
    let codes = content.strip_prefix(header.as_slice()).ok_or_else(|| damaged("another file"))?;
    let codes: Vec<f32> = codes.as_chunks().0.iter().map(|value| f32::from_le_bytes(*value)).collect();
    let is_sound = |(index, vector): (usize, &[f32])| super::check_vector(index, vector).is_ok();
    if codes.chunks_exact(key.feature_dim).enumerate().all(is_sound) { Ok(codes) } else { Err(damaged("not codes")) }
}

#[cfg(test)]
mod tests {
    use super::super::{Codebook, CodebookSettings};
    use super::*;

    /// Large enough to be cached.
    const SETTINGS: CodebookSettings = CodebookSettings { num_codes: 200, feature_dim: 28, seed: 4 };

    fn files(folder: &Path) -> Vec<PathBuf> {
        let mut files: Vec<PathBuf> = std::fs::read_dir(folder).unwrap().map(|entry| entry.unwrap().path()).collect();
        files.sort();
        files
    }

    /// Returns the codebook, and whether its codes were generated: then `progress` is called before the last step too.
    fn generate(cache: &CodebookCache) -> (Codebook, bool) {
        let mut steps = 0;
        let codebook = Codebook::generate_cached(&SETTINGS, cache, &mut |_| steps += 1).unwrap();
        (codebook, steps > 1)
    }

    #[test]
    fn codes_are_made_once() {
        let folder = tempfile::tempdir().unwrap();
        let cache = CodebookCache::in_folder(&folder.path().join("new/splatseg"));
        let (mut first, was_made) = generate(&cache);
        assert!(was_made);
        let (again, was_made) = generate(&cache);
        assert!(!was_made && again == first);
        assert_eq!(first, Codebook::generate(&SETTINGS, &mut |_| {}).unwrap());

        let mut extended = again.clone();
        extended.extend_cached(200, &cache, &mut |_| {}).unwrap();
        first.extend(200, &mut |_| {}).unwrap();
        assert_eq!(extended, first);
        assert_eq!(files(&folder.path().join("new/splatseg")).len(), 2);
        let mut calls = 0;
        let mut once_more = again;
        once_more.extend_cached(200, &cache, &mut |_| calls += 1).unwrap();
        assert!(calls == 1 && once_more == first);
    }

    #[test]
    fn damaged_files_are_made_again() {
        let folder = tempfile::tempdir().unwrap();
        let cache = CodebookCache::in_folder(folder.path());
        let (expected, _) = generate(&cache);
        let file = files(folder.path()).pop().unwrap();
        let whole = std::fs::read(&file).unwrap();
        let mut wrong_seed = whole.clone();
        wrong_seed[MAGIC.len() + 16] ^= 1;
        let end = wrong_seed.len() - 4;
        let checksum = crc32fast::hash(&wrong_seed[..end]).to_le_bytes();
        wrong_seed[end..].copy_from_slice(&checksum);
        let mut flipped = whole.clone();
        flipped[1000] ^= 1;
        // Codes in another order, with the checksum of the right one.
        let mut swapped = whole.clone();
        let codes = whole.len() - 4 - 200 * 28 * 4;
        let (first, second) = swapped[codes..codes + 2 * 28 * 4].split_at_mut(28 * 4);
        first.swap_with_slice(second);
        let not_codes = super::file(
            &BlockKey { earlier: &[], feature_dim: 28, count: 200, seed: 4, block: 0 },
            &vec![f32::NAN; 200 * 28],
        );
        assert_eq!(not_codes.len(), whole.len());
        let longer = [&whole[..], b"x"].concat();
        for damaged in [&whole[..whole.len() - 1], &longer, &flipped, &swapped, &wrong_seed, &not_codes, b""] {
            std::fs::write(&file, damaged).unwrap();
            let (found, was_made) = generate(&cache);
            assert!(was_made && found == expected);
            assert_eq!(std::fs::read(&file).unwrap(), whole, "and replaced");
        }
    }

    #[test]
    fn a_cache_that_cannot_be_written_is_no_error() {
        let folder = tempfile::tempdir().unwrap();
        std::fs::write(folder.path().join("file"), "").unwrap();
        let cache = CodebookCache::in_folder(&folder.path().join("file/below"));
        let (found, was_made) = generate(&cache);
        assert!(was_made && found == generate(&CodebookCache::default()).0);
    }

    #[test]
    fn keys_differ_in_all_that_codes_depend_on() {
        let key = BlockKey { earlier: &[1.0; 2], feature_dim: 2, count: 5, seed: 1, block: 1 };
        let others = [
            BlockKey { earlier: &[0.5; 2], ..key },
            BlockKey { feature_dim: 1, ..key },
            BlockKey { count: 6, ..key },
            BlockKey { seed: 2, ..key },
            BlockKey { block: 2, ..key },
        ];
        assert!(others.iter().all(|other| other.header() != key.header()));
    }
}
