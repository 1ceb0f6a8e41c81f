//! A view of a map on a device: which Gaussians are seen, in which tile, and what they are expected to show.

use crate::GpuError;
use crate::device::{Buffer, GpuDevice, threads};
use crate::gaussians::DeviceGaussians;
use crate::kernels::bin::{count_tiles, emit_pairs, find_tiles};
use crate::kernels::camera::{ViewLaunch, view_args};
use crate::kernels::expect::{IMAGES, SURFACES};
use crate::kernels::project::{NUMBERS, mark_visible, project_visible};
use crate::kernels::sight::{COUNTERS, PAIR_COUNT, VISIBLE_COUNT, contradicts_map, note_sights};
use crate::kernels::tile::{TilePairsLaunch, VisibleGaussiansLaunch};
use crate::sorting::{Keyed, prefix_sums, sorted};
use crate::store::{DeviceStore, Rendered};
use splatseg_geometry::{Image, RgbdFrame, SegmentMap};
use splatseg_memory::{DeviceImages, FrameTrust, GrowthRule, MemoryKind, MemorySettings, SegmentBelief};
use splatseg_render::Camera;
use std::sync::Mutex;

/// Bits of a depth as a sort key: positive floats have no sign.
const DEPTH_BITS: u32 = 32;

/// What the frame says of every Gaussian.
#[derive(Debug)]
pub(crate) struct Sights {
    /// One per Gaussian.
    pub sights: Buffer,
    /// Whether each can touch the image.
    pub visible: Buffer,
    /// [`COUNTERS`] of them.
    pub counters: Buffer,
    /// Whether earlier frames confirm this one.
    pub trust: FrameTrust,
    /// Gaussians of the map when it was looked at.
    pub count: usize,
}

/// The pairs of a tile and a Gaussian in it.
#[derive(Debug)]
pub(crate) struct Tiles {
    /// `[visible, 8]`.
    pub splats: Buffer,
    /// The Gaussian of each of `splats`.
    pub gaussians: Buffer,
    /// `splats` front to back.
    pub order: Buffer,
    /// The first pair of each in that order, and how many it has.
    pub starts: Buffer,
    pub tile_counts: Buffer,
    /// Whose each pair is.
    pub splat_of_pair: Buffer,
    /// Pairs by tile, front to back: those of a tile are from `begins` to `ends`.
    pub pairs: Buffer,
    pub begins: Buffer,
    pub ends: Buffer,
    pub visible_count: usize,
    pub pair_count: usize,
}

impl Tiles {
    /// The pairs as kernels take them.
    pub fn pairs(&self) -> TilePairsLaunch {
        TilePairsLaunch::new(
            self.splats.arg(),
            self.gaussians.arg(),
            self.splat_of_pair.arg(),
            self.pairs.arg(),
            self.begins.arg(),
            self.ends.arg(),
        )
    }

    /// The visible Gaussians as kernels take them.
    pub fn visible(&self) -> VisibleGaussiansLaunch {
        VisibleGaussiansLaunch::new(self.order.arg(), self.starts.arg(), self.tile_counts.arg(), self.gaussians.arg())
    }
}

/// A view, for the rest of its frame.
#[derive(Debug)]
pub(crate) struct GpuView {
    pub camera: Camera,
    /// The frame's depth, `[height, width]`.
    pub depth: Buffer,
    pub sights: Sights,
    pub tiles: Tiles,
    /// `[4, height, width]`, see [`IMAGES`].
    pub images: Buffer,
    /// `[2, height, width]`, see [`SURFACES`].
    pub surfaces: Buffer,
    /// The predictions that were sent last.
    pub seen: Mutex<Option<(SegmentMap, Buffer)>>,
}

impl GpuView {
    /// Number of pixels of the image.
    pub fn pixels(&self) -> usize {
        self.camera.intrinsics.width * self.camera.intrinsics.height
    }

    /// The camera as kernels take it.
    pub fn args(&self) -> ViewLaunch {
        view_args(&self.camera)
    }

    /// The frame's predictions on the device; they are sent only if they are not there.
    pub fn send_seen(&self, device: &GpuDevice, seen: &SegmentMap) -> Result<Buffer, GpuError> {
        let mut sent = self.seen.lock().unwrap_or_else(std::sync::PoisonError::into_inner);
        if let Some((known, buffer)) = sent.as_ref()
            && known == seen
        {
            return Ok(buffer.clone());
        }
        let buffer = device.upload(seen.pixels(), "predictions")?;
        *sent = Some((seen.clone(), buffer.clone()));
        Ok(buffer)
    }
}

/// Whether a memory compares its Gaussians with each frame's depth; the paper's does not.
pub(crate) fn needs_sights(settings: &MemorySettings) -> bool {
    settings.growth_rule() != GrowthRule::Paper || settings.kind == MemoryKind::Evidence
}

/// Compares all Gaussians with the frame's depth.
pub(crate) fn look(
    device: &GpuDevice,
    map: &DeviceGaussians,
    depth: &Buffer,
    camera: &Camera,
    trust: FrameTrust,
    settings: &MemorySettings,
) -> Result<Sights, GpuError> {
    let count = map.len();
    let sights = device.empty(count, "sights")?;
    let visible = device.empty(count, "visible Gaussians")?;
    let counters = device.zeros(COUNTERS, "counters")?;
    let (cube_count, cube) = threads(count);
    note_sights::launch(
        &device.client,
        cube_count.clone(),
        cube,
        map.balls().arg(),
        depth.arg(),
        sights.arg(),
        counters.arg(),
        view_args(camera),
        settings.removal_margin,
        settings.removal_margin_relative,
        count as u32,
    );
    let hides_through = settings.growth_rule() != GrowthRule::Paper && settings.removal_frames > 0;
    mark_visible::launch(
        &device.client,
        cube_count,
        cube,
        map.balls().arg(),
        sights.arg(),
        visible.arg(),
        counters.arg(),
        view_args(camera),
        u32::from(hides_through),
        u32::from(trust == FrameTrust::Confirmed),
        count as u32,
    );
    Ok(Sights { sights, visible, counters, trust, count })
}

/// Sorts the visible Gaussians into tiles, front to back.
pub(crate) fn bin(
    device: &GpuDevice,
    map: &DeviceGaussians,
    sights: &Sights,
    camera: &Camera,
) -> Result<Tiles, GpuError> {
    let client = &device.client;
    let places = prefix_sums(device, &sights.visible, sights.count)?;
    let [counters] = device.download([&sights.counters])?;
    let (visible, pairs) = (counters[VISIBLE_COUNT] as usize, counters[PAIR_COUNT] as usize);
    let splats = device.empty(visible * NUMBERS, "visible Gaussians")?;
    let gaussians = device.empty(visible, "visible Gaussians")?;
    let by_depth = Keyed { keys: device.empty(visible, "sort keys")?, values: device.empty(visible, "sort values")? };
    let (cube_count, cube) = threads(sights.count);
    project_visible::launch(
        client,
        cube_count,
        cube,
        map.balls().arg(),
        sights.visible.arg(),
        places.arg(),
        splats.arg(),
        gaussians.arg(),
        by_depth.keys.arg(),
        by_depth.values.arg(),
        view_args(camera),
        sights.count as u32,
    );
    let order = sorted(device, by_depth, visible, DEPTH_BITS)?.values;
    let in_order = InOrder { splats, gaussians, order, visible, pairs };
    sort_into_tiles(device, in_order, camera)
}

/// The visible Gaussians.
struct InOrder {
    splats: Buffer,
    gaussians: Buffer,
    /// `splats` front to back.
    order: Buffer,
    visible: usize,
    /// Pairs of a Gaussian and a tile that it touches.
    pairs: usize,
}

/// Writes the pairs front to back and sorts them by tile.
fn sort_into_tiles(device: &GpuDevice, in_order: InOrder, camera: &Camera) -> Result<Tiles, GpuError> {
    let client = &device.client;
    let InOrder { splats, gaussians, order, visible, pairs } = in_order;
    let tile_counts = device.empty(visible, "tiles of Gaussians")?;
    let (cube_count, cube) = threads(visible);
    let (view, count) = (view_args(camera), visible as u32);
    count_tiles::launch(client, cube_count.clone(), cube, splats.arg(), order.arg(), tile_counts.arg(), view, count);
    let starts = prefix_sums(device, &tile_counts, visible)?;
    let by_tile = Keyed { keys: device.empty(pairs, "sort keys")?, values: device.empty(pairs, "sort values")? };
    let splat_of_pair = device.empty(pairs, "pairs of Gaussian and tile")?;
    emit_pairs::launch(
        client,
        cube_count,
        cube,
        splats.arg(),
        order.arg(),
        starts.arg(),
        by_tile.keys.arg(),
        by_tile.values.arg(),
        splat_of_pair.arg(),
        view_args(camera),
        count,
    );
    let tiles = tile_count(camera);
    let by_tile = sorted(device, by_tile, pairs, tiles.next_power_of_two().ilog2().max(1))?;
    let (begins, ends) = (device.empty(tiles, "tiles")?, device.empty(tiles, "tiles")?);
    let (cube_count, cube) = threads(tiles);
    let keys = by_tile.keys.arg();
    find_tiles::launch(client, cube_count, cube, keys, begins.arg(), ends.arg(), pairs as u32, tiles as u32);
    let (visible_count, pair_count, pairs) = (visible, pairs, by_tile.values);
    Ok(Tiles {
        splats,
        gaussians,
        order,
        starts,
        tile_counts,
        splat_of_pair,
        pairs,
        begins,
        ends,
        visible_count,
        pair_count,
    })
}

/// Number of tiles of a camera's image.
pub(crate) fn tile_count(camera: &Camera) -> usize {
    camera.intrinsics.width.div_ceil(16) * camera.intrinsics.height.div_ceil(16)
}

/// Renders the map and reads what it expects.
pub(crate) fn render<S: DeviceStore>(
    device: &GpuDevice,
    map: &DeviceGaussians,
    store: &S,
    frame: &RgbdFrame<'_>,
    camera: &Camera,
    trust: FrameTrust,
    settings: &MemorySettings,
) -> Result<(Rendered<S::Read>, DeviceImages), GpuError> {
    let depth = device.upload(frame.depth().pixels(), "depth")?;
    let sights = look(device, map, &depth, camera, trust, settings)?;
    let tiles = bin(device, map, &sights, camera)?;
    let (width, height) = (frame.width(), frame.height());
    let images = device.empty(IMAGES * width * height, "images")?;
    let surfaces = device.empty(SURFACES * width * height, "images")?;
    let view = GpuView { camera: *camera, depth, sights, tiles, images, surfaces, seen: Mutex::new(None) };
    let read = store.expect(device, map, &view)?;
    let [found, counters] = device.download([&view.images, &view.sights.counters])?;
    let contradicts = needs_sights(settings) && contradicts_map(&counters);
    let images = images_of(&found, (width, height), contradicts).ok_or_else(|| GpuError::Failed {
        reason: format!("{} values came back for images of {width}x{height} pixels", found.len()),
    })?;
    Ok((Rendered { view, read }, images))
}

/// The images of a view.
fn images_of(values: &[u32], (width, height): (usize, usize), contradicts_map: bool) -> Option<DeviceImages> {
    let mut parts = values.chunks_exact((width * height).max(1));
    let segments = SegmentMap::from_pixels(width, height, parts.next()?.to_vec()).ok()?;
    let mut image = || {
        let pixels = parts.next()?.iter().map(|bits| f32::from_bits(*bits)).collect();
        Image::from_pixels(width, height, pixels).ok()
    };
    let (confidence, silhouette, depth) = (image()?, image()?, image()?);
    Some(DeviceImages { belief: SegmentBelief { segments, confidence }, silhouette, depth, contradicts_map })
}
