//! Grows pixels into patches by Felzenszwalb and Huttenlocher's graph-based segmentation.

use super::edges::{NEIGHBORS, NO_EDGE, QUANTA};
use super::settings::PatchSettings;

/// A partition of the image.
pub(super) struct Patches {
    /// Patch of each pixel, `[height, width]`, numbered from 0 in the order of their first pixel.
    pub labels: Vec<u32>,
    /// Number of patches.
    pub count: usize,
}

/// Merges pixels along their edges by increasing distance. Ties are in the order of the pixels.
pub(super) fn grow(edges: &[[u16; 4]], (width, height): (usize, usize), settings: &PatchSettings) -> Patches {
    let mut forest = Forest::new(width * height, settings.scale);
    let order = sorted(edges);
    let neighbor = |index: usize, direction: usize| {
        let (right, down) = NEIGHBORS[direction];
        // The edge exists, so the neighbour is inside the image.
        index.wrapping_add_signed(down * width as isize + right) as u32
    };
    for code in &order {
        let (index, direction) = ((code / 4) as usize, (code % 4) as usize);
        let (first, second) = (forest.root(index as u32), forest.root(neighbor(index, direction)));
        let distance = f32::from(edges[index][direction]) / QUANTA;
        if first != second && distance <= forest.limit[first as usize].min(forest.limit[second as usize]) {
            let united = forest.unite(first, second);
            forest.limit[united as usize] = distance + settings.scale / forest.area[united as usize] as f32;
        }
    }
    for code in &order {
        let (index, direction) = ((code / 4) as usize, (code % 4) as usize);
        let (first, second) = (forest.root(index as u32), forest.root(neighbor(index, direction)));
        let smaller = forest.area[first as usize].min(forest.area[second as usize]) as usize;
        if first != second && smaller < settings.min_area {
            forest.unite(first, second);
        }
    }
    forest.numbered()
}

/// All edges as codes `4 · pixel + direction`, sorted by distance, then by code (a counting sort).
fn sorted(edges: &[[u16; 4]]) -> Vec<u32> {
    let mut starts = vec![0u32; usize::from(NO_EDGE) + 1];
    for distance in edges.iter().flatten() {
        starts[usize::from(*distance)] += 1;
    }
    let mut total = 0;
    for start in &mut starts {
        (*start, total) = (total, total + *start);
    }
    let mut order = vec![0u32; starts[usize::from(NO_EDGE)] as usize];
    for (code, distance) in edges.iter().flatten().enumerate() {
        if *distance != NO_EDGE {
            let place = &mut starts[usize::from(*distance)];
            order[*place as usize] = code as u32;
            *place += 1;
        }
    }
    order
}

/// Disjoint sets of pixels.
struct Forest {
    parent: Vec<u32>,
    area: Vec<u32>,
    /// Maximum distance over which a root may be merged.
    limit: Vec<f32>,
}

impl Forest {
    fn new(count: usize, limit: f32) -> Self {
        Self { parent: (0..count as u32).collect(), area: vec![1; count], limit: vec![limit; count] }
    }

    fn root(&mut self, mut index: u32) -> u32 {
        while self.parent[index as usize] != index {
            let grandparent = self.parent[self.parent[index as usize] as usize];
            self.parent[index as usize] = grandparent;
            index = grandparent;
        }
        index
    }

    /// Unites two roots; returns the new root.
    fn unite(&mut self, first: u32, second: u32) -> u32 {
        let (large, small) =
            if self.area[first as usize] >= self.area[second as usize] { (first, second) } else { (second, first) };
        self.parent[small as usize] = large;
        self.area[large as usize] += self.area[small as usize];
        large
    }

    fn numbered(mut self) -> Patches {
        const NONE: u32 = u32::MAX;
        let mut numbers = vec![NONE; self.parent.len()];
        let mut count = 0;
        let labels = (0..self.parent.len() as u32)
            .map(|index| {
                let number = &mut numbers[self.root(index) as usize];
                if *number == NONE {
                    *number = count;
                    count += 1;
                }
                *number
            })
            .collect();
        Patches { labels, count: count as usize }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    const SETTINGS: PatchSettings =
        PatchSettings { color: 1.0, step: 1.0, concave: 1.0, convex: 1.0, scale: 0.5, min_area: 2 };

    proptest! {
        #[test]
        fn counting_sorts_like_a_stable_sort(edges in prop::collection::vec(any::<[u16; 4]>(), 0..50)) {
            let flat: Vec<u16> = edges.iter().flatten().copied().collect();
            let mut expected: Vec<u32> = (0..flat.len() as u32).filter(|code| flat[*code as usize] != NO_EDGE).collect();
            expected.sort_by_key(|code| flat[*code as usize]);
            prop_assert_eq!(sorted(&edges), expected);
        }
    }

    #[test]
    fn patches_end_at_distant_pixels_and_small_ones_join() {
        // A row of pixels 0 1 2 | 3 4 5 | 6, where | is a large distance.
        let far = (2.0 * QUANTA) as u16;
        let edges = [0, 0, far, 0, 0, far + 1, NO_EDGE].map(|right| [right, NO_EDGE, NO_EDGE, NO_EDGE]);
        let patches = grow(&edges, (7, 1), &SETTINGS);
        assert_eq!(patches.labels, [0, 0, 0, 1, 1, 1, 1]);
        assert_eq!(patches.count, 2);
        let patches = grow(&edges, (7, 1), &PatchSettings { min_area: 0, ..SETTINGS });
        assert_eq!(patches.labels, [0, 0, 0, 1, 1, 1, 2]);
    }
}
