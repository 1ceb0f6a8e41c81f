//! Saving a memory after one run and continuing it in another.

use crate::co_visible::CoVisibleIds;
use crate::patches::PatchGraph;
use crate::recent::RecentFrames;
use crate::saved_state::{SavedState, restored_runs, runs};
use crate::segments::{SavedSegment, Segments};
use crate::{
    LoadMemoryError, MemoryError, MemorySettings, SavedStore, SplatFile, SplatFileError, SplatFileView, SplatMemory,
};
use splatseg_files::StateBlock;
use splatseg_geometry::{SegmentId, SurfaceKind};
use std::path::Path;

/// State of other parts of a pipeline about a map, saved with it: bytes of a [`StateBlock`] each, whose arrays only they
/// can read.
#[derive(Clone, Copy, Debug, Default)]
pub struct Attached<'a> {
    /// The camera's keyframes; [`SplatMemory::take_keyframes`] returns them after loading.
    pub keyframes: Option<&'a [u8]>,
    /// The names of objects; [`SplatMemory::take_names`] returns them after loading.
    pub names: Option<&'a [u8]>,
    /// When objects were seen, and the rooms so far; [`SplatMemory::take_history`] returns them after loading.
    pub history: Option<&'a [u8]>,
}

/// Writes a memory to a PLY file: see [`SplatMemory::save_with`].
pub(crate) fn save(memory: &SplatMemory, path: &Path, attached: Attached<'_>) -> Result<(), SplatFileError> {
    let no_format = || SplatFileError::NoFormat { path: path.to_owned() };
    // What was decided counts as votes, as the map shows it; the memory itself stays as it is.
    let verdicts = memory.patches.verdicts();
    let content = memory.store.content_with(&verdicts).ok_or_else(no_format)?;
    let attached_block = |bytes: Option<&[u8]>| {
        let block = bytes.map_or(Ok(StateBlock::default()), StateBlock::from_bytes);
        block.map_err(|error| SplatFileError::State { path: path.to_owned(), found: error.to_string() })
    };
    let segment_ids = memory.store.segment_ids_with(&verdicts);
    let segments = memory.segments.with_shown(verdicts.iter().map(|verdict| verdict.id));
    let live = segments.saved_live();
    let ids: Vec<SegmentId> = live.iter().map(|segment| segment.id).collect();
    let sightings: Vec<u32> = live.iter().map(|segment| segment.sightings).collect();
    let carried: Vec<bool> = live.iter().map(|segment| segment.carried).collect();
    let is_observed = memory.map.surfaces.iter().all(|surface| *surface == SurfaceKind::Observed);
    let (together, crowded) = memory.co_visible.saved();
    let saved_state = SavedState {
        ids: segments.saved_ids(),
        patches: memory.patches.saved(),
        recent: memory.recent.saved(),
        anchors: runs(&memory.map.anchors),
        surfaces: if is_observed { Vec::new() } else { runs(&memory.map.surfaces) },
        together,
        crowded,
        remapped: memory.remapped.iter().map(|(from, into)| [*from, *into]).collect(),
        keyframes: attached_block(attached.keyframes)?,
        names: attached_block(attached.names)?,
        history: attached_block(attached.history)?,
    };
    let saved_state = saved_state.into_block();
    let view = SplatFileView {
        origin: memory.origin,
        map: &memory.map,
        content,
        registered_kind: memory.settings.kind.registered_name(),
        segment_ids: &segment_ids,
        ids: &ids,
        sightings: &sightings,
        carried: &carried,
        frames: memory.frames,
        saved_state: &saved_state,
    };
    view.save(path)
}

/// Loads a saved memory: see [`SplatMemory::load`].
pub(crate) fn load(path: &Path, settings: MemorySettings) -> Result<SplatMemory, LoadMemoryError> {
    settings.validate().map_err(MemoryError::from)?;
    let file = SplatFile::load(path)?;
    if let Some(found) = file.registered_kind.clone().filter(|name| name != settings.kind.name()) {
        let (path, expected) = (path.display().to_string(), settings.kind.name());
        return Err(LoadMemoryError::Kind { path, found, expected });
    }
    let SplatFile { origin, mut map, content, ids, sightings, carried, frames, saved_state, .. } = file;
    let live = ids.into_iter().zip(sightings).zip(carried);
    let live: Vec<SavedSegment> =
        live.map(|((id, sightings), carried)| SavedSegment { id, sightings, carried }).collect();
    let largest_id = settings.kind.rules(&settings).largest_id;
    let saved = SavedState::from_block(saved_state).map_err(|error| error.to_string());
    let restored = saved.and_then(|saved| {
        let segments = Segments::restored(&live, saved.ids.clone(), largest_id)?;
        let recent = RecentFrames::restored(saved.recent, segments.highest())?;
        map.anchors = restored_runs("keyframes", &saved.anchors, map.len(), 0)?;
        map.surfaces = restored_runs("surfaces", &saved.surfaces, map.len(), SurfaceKind::Observed)?;
        let patches = PatchGraph::restored(saved.patches, map.len(), segments.highest())?;
        let together = CoVisibleIds::restored((saved.together, saved.crowded));
        let bytes = |block: StateBlock| (!block.is_empty()).then(|| block.to_bytes()).transpose();
        let attached =
            bytes(saved.keyframes).and_then(|keyframes| Ok((keyframes, bytes(saved.names)?, bytes(saved.history)?)));
        Ok((segments, patches, recent, together, saved.remapped, attached.map_err(|error| error.to_string())?))
    });
    let damaged = |found| LoadMemoryError::SavedState { path: path.display().to_string(), found };
    let (segments, patches, recent, together, remapped, attached) = restored.map_err(damaged)?;
    let saved = SavedStore { path, content, gaussians: map.len(), highest_id: segments.highest() };
    let store = (settings.kind.definition().restore)(&settings, saved)?;
    let mut memory = SplatMemory::with_parts(settings, map, store, segments);
    (memory.frames, memory.origin) = (frames, origin);
    (memory.patches, memory.recent, memory.co_visible) = (patches, recent, together);
    memory.remapped = remapped.into_iter().map(|[from, into]| (from, into)).collect();
    (memory.keyframes, memory.names, memory.history) = attached;
    Ok(memory)
}
