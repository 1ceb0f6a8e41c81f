//! Vector instruction sets: compiling loops for each of them, and choosing one at run time.

use pulp::{Simd, WithSimd};
use std::ffi::OsString;
use std::fmt;
use std::sync::OnceLock;

/// Lanes of the widest vector of `f32`. Loops over slices work in chunks of this length.
pub const LANES: usize = 16;

/// An instruction set that loops are compiled for.
///
/// Networks give the same result with all of them except `Portable`, which rounds after each product and each sum; the
/// others round once, after the fused multiply-add.
#[derive(Clone, Copy, Debug)]
#[non_exhaustive]
pub enum Instructions {
    /// AVX-512.
    #[cfg(target_arch = "x86_64")]
    V4(pulp::x86::V4),
    /// AVX2 and FMA.
    #[cfg(target_arch = "x86_64")]
    V3(pulp::x86::V3),
    /// NEON.
    #[cfg(target_arch = "aarch64")]
    Neon(pulp::aarch64::Neon),
    /// The baseline of the target, without fused multiply-add.
    Portable,
}

/// The environment variable that selects a set.
const VARIABLE: &str = "SPLATSEG_INSTRUCTIONS";

/// The environment variable `SPLATSEG_INSTRUCTIONS` names no set that this machine supports.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct InstructionsError {
    /// Its value.
    found: String,
    /// The names of the sets that this machine supports.
    expected: Vec<&'static str>,
}

impl fmt::Display for InstructionsError {
    fn fmt(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { found, expected } = self;
        let expected = expected.join(", ");
        write!(formatter, "{VARIABLE} is {found:?}, expected one that this machine supports: {expected}")
    }
}

impl std::error::Error for InstructionsError {}

/// The set with the name in the environment variable; `None` if it is not set, or empty.
fn chosen(available: &[Instructions], wanted: Option<OsString>) -> Result<Option<Instructions>, InstructionsError> {
    let Some(wanted) = wanted.filter(|wanted| !wanted.is_empty()) else { return Ok(None) };
    let set = available.iter().find(|set| wanted == set.name()).copied();
    set.map(Some).ok_or_else(|| InstructionsError {
        found: wanted.to_string_lossy().into_owned(),
        expected: available.iter().map(|set| set.name()).collect(),
    })
}

/// Work that [`Instructions::run`] compiles for every instruction set. Every function it calls must be
/// `#[inline(always)]`.
///
/// Closures marked `#[inline(always)]` implement this trait. They are called through `FnMut` rather than `FnOnce`: for
/// `FnOnce` the compiler creates a shim, which it may compile for the baseline processor.
pub trait Vectorize {
    /// The return type.
    type Output;

    /// Does the work. Implementations must be `#[inline(always)]`.
    fn run(self) -> Self::Output;
}

impl<R, F: FnMut() -> R> Vectorize for F {
    type Output = R;

    #[inline(always)]
    fn run(mut self) -> R {
        self()
    }
}

/// Adapts [`Vectorize`] to pulp.
struct Work<W>(W);

impl<W: Vectorize> WithSimd for Work<W> {
    type Output = W::Output;

    #[inline(always)]
    fn with_simd<S: Simd>(self, _: S) -> W::Output {
        self.0.run()
    }
}

/// Work on tiles of `ROWS` × (`VECTORS` vectors) held in registers.
pub(crate) trait TileKernel {
    fn run<S: Simd, const ROWS: usize, const VECTORS: usize, const FUSED: bool>(self, simd: S);
}

/// A [`TileKernel`] with the tile size of an instruction set.
struct Tiled<K, const ROWS: usize, const VECTORS: usize, const FUSED: bool>(K);

impl<K: TileKernel, const ROWS: usize, const VECTORS: usize, const FUSED: bool> WithSimd
    for Tiled<K, ROWS, VECTORS, FUSED>
{
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) {
        self.0.run::<S, ROWS, VECTORS, FUSED>(simd);
    }
}

/// `factor · value + sum`, rounded once if `FUSED`, else twice.
#[inline(always)]
pub(crate) fn multiply_add<S: Simd, const FUSED: bool>(
    simd: S,
    factor: S::f32s,
    value: S::f32s,
    sum: S::f32s,
) -> S::f32s {
    if FUSED { simd.mul_add_f32s(factor, value, sum) } else { simd.add_f32s(simd.mul_f32s(factor, value), sum) }
}

impl Instructions {
    /// All sets that this machine supports, best first.
    pub fn available() -> Vec<Self> {
        let mut sets = Vec::new();
        #[cfg(target_arch = "x86_64")]
        {
            sets.extend(pulp::x86::V4::try_new().map(Self::V4));
            sets.extend(pulp::x86::V3::try_new().map(Self::V3));
        }
        #[cfg(target_arch = "aarch64")]
        sets.extend(pulp::aarch64::Neon::try_new().map(Self::Neon));
        sets.push(Self::Portable);
        sets
    }

    /// Returns the best set that this machine supports. For measurements, the environment variable
    /// `SPLATSEG_INSTRUCTIONS` (`avx512`, `avx2`, `neon` or `portable`) selects another supported set. Results are the
    /// same with AVX2 and AVX-512. Other values of the variable are ignored: [`Self::check_choice`] reports them.
    #[inline]
    pub fn best() -> Self {
        static BEST: OnceLock<Instructions> = OnceLock::new();
        *BEST.get_or_init(|| {
            let available = Self::available();
            let best = available.first().copied().unwrap_or(Self::Portable);
            chosen(&available, std::env::var_os(VARIABLE)).ok().flatten().unwrap_or(best)
        })
    }

    /// Checks the environment variable `SPLATSEG_INSTRUCTIONS`.
    ///
    /// # Errors
    /// If it names no set that this machine supports.
    pub fn check_choice() -> Result<(), InstructionsError> {
        chosen(&Self::available(), std::env::var_os(VARIABLE)).map(drop)
    }

    /// Name in `SPLATSEG_INSTRUCTIONS`.
    fn name(self) -> &'static str {
        match self {
            #[cfg(target_arch = "x86_64")]
            Self::V4(_) => "avx512",
            #[cfg(target_arch = "x86_64")]
            Self::V3(_) => "avx2",
            #[cfg(target_arch = "aarch64")]
            Self::Neon(_) => "neon",
            Self::Portable => "portable",
        }
    }

    /// Rows of a tile of the GEMM microkernel.
    pub fn rows(self) -> usize {
        match self {
            #[cfg(target_arch = "x86_64")]
            Self::V4(_) => 8,
            #[cfg(target_arch = "x86_64")]
            Self::V3(_) => 6,
            #[cfg(target_arch = "aarch64")]
            Self::Neon(_) => 6,
            Self::Portable => 4,
        }
    }

    /// Columns of a tile, a multiple of [`LANES`].
    pub fn columns(self) -> usize {
        match self {
            #[cfg(target_arch = "x86_64")]
            Self::V4(_) => 32,
            _ => 16,
        }
    }

    /// Runs `work`, compiled for these instructions: its loops over slices become vector code.
    #[inline(always)]
    pub fn run<W: Vectorize>(self, work: W) -> W::Output {
        self.run_simd(Work(work))
    }

    /// Runs work that uses explicit vectors.
    #[inline(always)]
    pub(crate) fn run_simd<W: WithSimd>(self, work: W) -> W::Output {
        match self {
            #[cfg(target_arch = "x86_64")]
            Self::V4(simd) => Simd::vectorize(simd, work),
            #[cfg(target_arch = "x86_64")]
            Self::V3(simd) => Simd::vectorize(simd, work),
            #[cfg(target_arch = "aarch64")]
            Self::Neon(simd) => Simd::vectorize(simd, work),
            Self::Portable => Simd::vectorize(pulp::Scalar128b, work),
        }
    }

    /// Runs a kernel with these instructions and their tile size.
    #[inline(always)]
    pub(crate) fn run_tiled<K: TileKernel>(self, kernel: K) {
        match self {
            #[cfg(target_arch = "x86_64")]
            Self::V4(simd) => Simd::vectorize(simd, Tiled::<K, 8, 2, true>(kernel)),
            #[cfg(target_arch = "x86_64")]
            Self::V3(simd) => Simd::vectorize(simd, Tiled::<K, 6, 2, true>(kernel)),
            #[cfg(target_arch = "aarch64")]
            Self::Neon(simd) => Simd::vectorize(simd, Tiled::<K, 6, 4, true>(kernel)),
            Self::Portable => Simd::vectorize(pulp::Scalar128b, Tiled::<K, 4, 4, false>(kernel)),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn only_supported_sets_can_be_chosen() {
        let sets = Instructions::available();
        let name = |wanted: &str| chosen(&sets, Some(wanted.into())).map(|set| set.map(Instructions::name));
        assert_eq!((name("portable"), name("")), (Ok(Some("portable")), Ok(None)));
        assert_eq!(chosen(&sets, None).unwrap().map(Instructions::name), None);
        let error = name("sse9").unwrap_err().to_string();
        assert!(
            error.starts_with("SPLATSEG_INSTRUCTIONS is \"sse9\", expected one that this machine supports: "),
            "{error}"
        );
        assert!(error.ends_with("portable"), "{error}");
    }
}
