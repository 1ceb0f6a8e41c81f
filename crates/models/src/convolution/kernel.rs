//! The inner loop: a tile of 8 output channels × some columns, kept in registers over the whole sum.

use super::Activation;
use pulp::{Simd, WithSimd};

/// Output channels of a tile; weights are stored in panels of this many rows.
pub(super) const PANEL: usize = 8;
/// Most columns that a tile can have: three vectors of sixteen.
pub(super) const MAX_TILE_COLUMNS: usize = 48;

/// Which instructions the kernel is compiled for. All give the same result but `Portable`, which rounds twice where
/// the others round once.
#[derive(Clone, Copy, Debug)]
pub(super) enum Instructions {
    /// AVX-512.
    #[cfg(target_arch = "x86_64")]
    V4(pulp::x86::V4),
    /// AVX2 and FMA.
    #[cfg(target_arch = "x86_64")]
    V3(pulp::x86::V3),
    /// NEON.
    #[cfg(target_arch = "aarch64")]
    Neon(pulp::aarch64::Neon),
    /// Whatever the target's baseline is; no fused multiply-add is assumed.
    Portable,
}

impl Instructions {
    /// Every set that this machine runs, best first.
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

    /// The best set that this machine runs.
    pub fn best() -> Self {
        Self::available()[0]
    }

    /// Computes all tiles of `product`; `write` gets each.
    pub fn run(self, product: Product, write: impl FnMut(Tile)) {
        match self {
            #[cfg(target_arch = "x86_64")]
            Self::V4(simd) => Simd::vectorize(simd, Tiling::<_, 8, true> { product, write }),
            #[cfg(target_arch = "x86_64")]
            Self::V3(simd) => Simd::vectorize(simd, Tiling::<_, 4, true> { product, write }),
            #[cfg(target_arch = "aarch64")]
            Self::Neon(simd) => Simd::vectorize(simd, Tiling::<_, 8, true> { product, write }),
            Self::Portable => Simd::vectorize(pulp::Scalar128b, Tiling::<_, 4, false> { product, write }),
        }
    }
}

/// A product of weights with shifted copies of a strip's planes: output (m, q) is
/// bias\[m\] + Σ over channels c and taps t of weight\[m, c, t\] · strip\[c · plane + tap\[t\] + q\].
#[derive(Clone, Copy)]
pub(super) struct Product<'a> {
    /// Panels of [`PANEL`] output channels; in each, channel by channel and tap by tap, the rows' weights.
    pub weights: &'a [f32],
    /// One per output channel, up to a whole panel.
    pub bias: &'a [f32],
    pub activation: Activation,
    pub strip: &'a [f32],
    /// Length of one channel's part of the strip; behind the last column lie [`MAX_TILE_COLUMNS`] more.
    pub plane: usize,
    pub taps: &'a [usize],
    /// Columns to compute.
    pub columns: usize,
}

/// Finished outputs: rows `row..row + rows` (counted from the product's first), columns from `column`.
pub(super) struct Tile<'a> {
    pub row: usize,
    pub column: usize,
    /// Row-major; the last tile of a row has columns behind the product's last, which mean nothing.
    pub values: &'a [f32],
    /// Columns in `values`.
    pub width: usize,
}

struct Tiling<'a, W, const ROWS: usize, const FUSED: bool> {
    product: Product<'a>,
    write: W,
}

impl<W: FnMut(Tile), const ROWS: usize, const FUSED: bool> WithSimd for Tiling<'_, W, ROWS, FUSED> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(mut self, simd: S) {
        let product = self.product;
        let channels = product.strip.len() / product.plane;
        let panel_len = channels * product.taps.len() * PANEL;
        let biases = product.bias.as_chunks::<PANEL>().0;
        let mut values = [0.0; PANEL * MAX_TILE_COLUMNS];
        for (panel, (weights, bias)) in product.weights.chunks_exact(panel_len).zip(biases).enumerate() {
            let mut column = 0;
            while column < product.columns {
                let vectors = (product.columns - column).div_ceil(S::F32_LANES).min(3);
                let width = vectors * S::F32_LANES;
                for first in (0..PANEL).step_by(ROWS) {
                    let source = Operands { product, weights, bias, column, first };
                    let values = &mut values[first * width..];
                    match vectors {
                        1 => tile::<S, ROWS, 1, FUSED>(simd, source, values),
                        2 => tile::<S, ROWS, 2, FUSED>(simd, source, values),
                        _ => tile::<S, ROWS, 3, FUSED>(simd, source, values),
                    }
                }
                (self.write)(Tile { row: panel * PANEL, column, values: &values, width });
                column += width;
            }
        }
    }
}

/// What one tile is made of.
#[derive(Clone, Copy)]
struct Operands<'a> {
    product: Product<'a>,
    /// One panel.
    weights: &'a [f32],
    bias: &'a [f32; PANEL],
    column: usize,
    /// First row within the panel.
    first: usize,
}

#[inline(always)]
fn tile<S: Simd, const ROWS: usize, const VECTORS: usize, const FUSED: bool>(
    simd: S,
    source: Operands,
    values: &mut [f32],
) {
    let Product { strip, plane, taps, activation, .. } = source.product;
    let width = VECTORS * S::F32_LANES;
    let rows = source.first..source.first + ROWS;
    let mut sums = [[simd.splat_f32s(0.0); VECTORS]; ROWS];
    for (sum, bias) in sums.iter_mut().zip(&source.bias[rows.clone()]) {
        *sum = [simd.splat_f32s(*bias); VECTORS];
    }
    let weights = source.weights.as_chunks::<PANEL>().0.chunks_exact(taps.len());
    for (plane, weights) in strip.chunks_exact(plane).zip(weights) {
        let plane = &plane[source.column..];
        for (tap, weights) in taps.iter().zip(weights) {
            let pixels: &[S::f32s; VECTORS] = S::as_simd_f32s(&plane[*tap..*tap + width]).0.try_into().unwrap();
            let pixels = *pixels;
            let weights: &[f32; ROWS] = weights[rows.clone()].try_into().unwrap();
            for row in 0..ROWS {
                let weight = simd.splat_f32s(weights[row]);
                for vector in 0..VECTORS {
                    sums[row][vector] = mul_add::<S, FUSED>(simd, weight, pixels[vector], sums[row][vector]);
                }
            }
        }
    }
    let (out, _) = S::as_mut_simd_f32s(&mut values[..ROWS * width]);
    for (out, sum) in out.chunks_exact_mut(VECTORS).zip(sums) {
        for (out, sum) in out.iter_mut().zip(sum) {
            *out = match activation {
                Activation::None => sum,
                Activation::Silu => silu::<S, FUSED>(simd, sum),
            };
        }
    }
}

/// a · b + c, rounded once if `FUSED`.
#[inline(always)]
fn mul_add<S: Simd, const FUSED: bool>(simd: S, a: S::f32s, b: S::f32s, c: S::f32s) -> S::f32s {
    if FUSED { simd.mul_add_f32s(a, b, c) } else { simd.add_f32s(simd.mul_f32s(a, b), c) }
}

/// x · σ(x) = x / (1 + e^-x), to about 2 units in the last place.
#[inline(always)]
fn silu<S: Simd, const FUSED: bool>(simd: S, x: S::f32s) -> S::f32s {
    // e^z = 2^n e^r with n = round(z / ln 2). Adding 1.5 · 2^23 rounds to the nearest whole number and leaves it in the
    // low bits.
    let z = simd.max_f32s(simd.min_f32s(simd.neg_f32s(x), simd.splat_f32s(88.0)), simd.splat_f32s(-87.0));
    let shifted =
        mul_add::<S, FUSED>(simd, z, simd.splat_f32s(core::f32::consts::LOG2_E), simd.splat_f32s(12_582_912.0));
    let n = simd.sub_f32s(shifted, simd.splat_f32s(12_582_912.0));
    // ln 2 in two parts, the first with so few bits that n times it is exact.
    let r = mul_add::<S, FUSED>(simd, n, simd.splat_f32s(-0.693_359_4), z);
    let r = mul_add::<S, FUSED>(simd, n, simd.splat_f32s(2.121_944_4e-4), r);
    // Minimax polynomial of Cephes' expf on [-ln 2 / 2, ln 2 / 2].
    let mut p = simd.splat_f32s(1.987_569_1e-4);
    for coefficient in [1.398_199_9e-3, 8.333_452e-3, 4.166_579_6e-2, 0.166_666_65, 0.5] {
        p = mul_add::<S, FUSED>(simd, p, r, simd.splat_f32s(coefficient));
    }
    let e = simd.add_f32s(mul_add::<S, FUSED>(simd, p, simd.mul_f32s(r, r), r), simd.splat_f32s(1.0));
    let exponent = simd.wrapping_dyn_shl_u32s(simd.transmute_u32s_f32s(shifted), simd.splat_u32s(23));
    let scale = simd.transmute_f32s_u32s(simd.add_u32s(exponent, simd.splat_u32s(127 << 23)));
    simd.div_f32s(x, mul_add::<S, FUSED>(simd, e, scale, simd.splat_f32s(1.0)))
}
