//! A tile and its threads, one per pixel: they take its Gaussians front to back, batch by batch, and blend each.

use super::blend::{PIXELS, Pixel, STAGED, Transmittance, alpha_at, blend, pixel_of, stage};
use super::camera::View;
use cubecl::prelude::*;

/// The pairs of a tile and a Gaussian in it; see `Tiles` in `view.rs`.
#[derive(CubeLaunch, CubeType)]
pub(crate) struct TilePairs {
    /// `[visible, 8]`.
    pub splats: Box<[f32]>,
    /// The Gaussian of each of `splats`.
    pub gaussians: Box<[u32]>,
    /// Whose of `splats` each pair is.
    pub splat_of_pair: Box<[u32]>,
    /// Pairs by tile, front to back: those of a tile are from `begins` to `ends`.
    pub pairs: Box<[u32]>,
    pub begins: Box<[u32]>,
    pub ends: Box<[u32]>,
}

/// The Gaussians that can touch the image, front to back; see `Tiles` in `view.rs`.
#[derive(CubeLaunch, CubeType)]
pub(crate) struct VisibleGaussians {
    /// The projected Gaussian of each.
    pub order: Box<[u32]>,
    /// The first pair of each, and how many it has.
    pub starts: Box<[u32]>,
    pub tile_counts: Box<[u32]>,
    /// The Gaussian of each that is projected.
    pub gaussians: Box<[u32]>,
}

/// A tile that is blended, as one of its threads has it.
#[derive(CubeType)]
pub(crate) struct Tile {
    pub pixel: Pixel,
    number: u32,
    /// Its first pair, and how many it has.
    begin: u32,
    pub count: u32,
    /// The pixel's light.
    pub behind: Transmittance,
    /// What the threads share of a batch: Gaussians and their boxes as [`stage`] writes them, their pairs and numbers.
    staged: Shared<[f32]>,
    boxes: Shared<[u32]>,
    pairs: Shared<[u32]>,
    gaussians: Shared<[u32]>,
    /// Most Gaussians of a batch.
    #[cube(comptime)]
    batch: u32,
}

#[cube]
impl Tile {
    /// This cube's tile, to be blended in batches of so many Gaussians.
    pub fn new(tiles: &TilePairs, view: &View, #[comptime] batch: u32) -> Tile {
        let number = CUBE_POS as u32;
        let pixel = pixel_of(number, view);
        let behind = Transmittance { value: 1.0f32, is_live: pixel.is_inside };
        let begin = tiles.begins[CUBE_POS];
        let slots = comptime!(batch as usize);
        Tile {
            pixel,
            number,
            begin,
            count: tiles.ends[CUBE_POS] - begin,
            behind,
            staged: Shared::<[f32]>::new_slice(slots * STAGED),
            boxes: Shared::<[u32]>::new_slice(slots),
            pairs: Shared::<[u32]>::new_slice(slots),
            gaussians: Shared::<[u32]>::new_slice(slots),
            batch,
        }
    }

    /// Stages the batch of the pairs from number `first` on; returns how many there are. All threads take part.
    pub fn stage(&mut self, tiles: &TilePairs, view: &View, first: u32) -> u32 {
        let unit = UNIT_POS as usize;
        let left = self.count - first;
        let here = select(left < self.batch, left, self.batch);
        sync_cube();
        if UNIT_POS < here {
            let pair = tiles.pairs[(self.begin + first + UNIT_POS) as usize];
            let splat = tiles.splat_of_pair[pair as usize] as usize;
            stage(&tiles.splats, splat, self.number, view, &mut self.staged, &mut self.boxes, unit);
            self.pairs[unit] = pair;
            self.gaussians[unit] = tiles.gaussians[splat];
        }
        sync_cube();
        here
    }

    /// The alpha of the Gaussian in `slot` at the pixel, 0 where it is skipped or the pixel takes no more.
    pub fn alpha(&self, slot: usize, view: &View) -> f32 {
        let mut alpha = 0.0f32;
        if self.behind.is_live {
            alpha = alpha_at(&self.staged, &self.boxes, slot, &self.pixel, view);
        }
        alpha
    }

    /// Blends the Gaussian in `slot`; returns its weight.
    pub fn blend(&mut self, slot: usize, view: &View) -> f32 {
        let alpha = self.alpha(slot, view);
        blend(alpha, &mut self.behind, view)
    }

    /// Blends the batch of `here` Gaussians into `weights` `[batch, 256]`. All threads take part.
    pub fn blend_batch(&mut self, here: u32, weights: &mut Shared<[f32]>, view: &View) {
        for slot in 0..here {
            let slot = slot as usize;
            weights[slot * PIXELS + UNIT_POS as usize] = self.blend(slot, view);
        }
        sync_cube();
    }

    /// The depth of the Gaussian in `slot`, metres.
    pub fn depth(&self, slot: usize) -> f32 {
        self.staged[slot * STAGED + 5]
    }

    /// The box of the Gaussian in `slot`.
    pub fn bits(&self, slot: usize) -> u32 {
        self.boxes[slot]
    }

    /// The pair in `slot`.
    pub fn pair(&self, slot: usize) -> u32 {
        self.pairs[slot]
    }
}

/// What a pixel sums up over the Gaussians that it shows.
#[cube]
pub(crate) trait PixelReader: CubeType + 'static + Send + Sync {
    /// What the Gaussians remember of segments.
    type Remembered: CubeType;

    /// Adds a Gaussian at this depth, metres, behind the others.
    fn add(&mut self, remembered: &Self::Remembered, gaussian: usize, weight: f32, depth: f32);
}

/// Blends a tile at this thread's pixel. The pairs that no pixel shows are dropped from `tiles`.
#[cube]
pub(crate) fn read_tile<R: PixelReader>(mut tiles: TilePairs, view: &View, remembered: &R::Remembered, reader: &mut R) {
    let mut tile = Tile::new(&tiles, view, 256u32);
    let mut used = Shared::<[u32]>::new_slice(PIXELS);
    let mut flags = Shared::<[u32]>::new_slice(2usize);
    let unit = UNIT_POS as usize;
    let mut kept = 0u32;
    for batch in 0..tile.count.div_ceil(256) {
        sync_cube();
        if unit < 2 {
            flags[unit] = 0u32;
        }
        used[unit] = 0u32;
        sync_cube();
        if tile.behind.is_live {
            // All threads that write write the same.
            flags[0] = 1u32;
        }
        let here = tile.stage(&tiles, view, batch * 256);
        if flags[0] == 0 {
            break;
        }
        for slot in 0..here {
            let slot = slot as usize;
            let alpha = tile.alpha(slot, view);
            if alpha > 0.0 {
                used[slot] = 1u32;
            }
            let weight = blend(alpha, &mut tile.behind, view);
            if weight > 0.0 {
                reader.add(remembered, tile.gaussians[slot] as usize, weight, tile.depth(slot));
            }
        }
        kept += keep_used(&mut tiles.pairs, tile.begin + kept, &tile, &used, &mut flags);
    }
    if UNIT_POS == 0 {
        tiles.ends[CUBE_POS] = tile.begin + kept;
    }
}

/// Moves the pairs of a batch that are used to `to`, in their order; returns how many there are. All threads take part.
#[cube]
fn keep_used(pairs: &mut [u32], to: u32, tile: &Tile, used: &Shared<[u32]>, flags: &mut Shared<[u32]>) -> u32 {
    let unit = UNIT_POS as usize;
    sync_cube();
    let mut rank = 0u32;
    for slot in 0..unit {
        rank += used[slot];
    }
    if used[unit] == 1 {
        pairs[(to + rank) as usize] = tile.pair(unit);
    }
    if UNIT_POS == 255 {
        flags[1] = rank + used[unit];
    }
    sync_cube();
    flags[1]
}
