//! Connected parts of an image.

/// Returns the 4-connected component of the pixel `start` among the pixels for which `is_inside(index)` is true, `start`
/// included. Indices are row-major in an image of `size` `(width, height)`. The pixels found are marked in `is_visited`,
/// and pixels that are marked already are left out.
///
/// # Panics
/// If `start` is not a pixel of the image or `is_visited` has another size.
pub fn flood_fill(
    start: usize,
    (width, height): (usize, usize),
    is_visited: &mut [bool],
    is_inside: impl Fn(usize) -> bool,
) -> Vec<usize> {
    assert_eq!(is_visited.len(), width * height, "one mark per pixel");
    is_visited[start] = true;
    let mut found = vec![start];
    let mut next = 0;
    while let Some(index) = found.get(next).copied() {
        next += 1;
        let neighbours = [
            (index % width > 0).then(|| index - 1),
            (index % width + 1 < width).then_some(index + 1),
            (index >= width).then(|| index - width),
            (index + width < width * height).then_some(index + width),
        ];
        for neighbour in neighbours.into_iter().flatten() {
            if is_inside(neighbour) && !is_visited[neighbour] {
                is_visited[neighbour] = true;
                found.push(neighbour);
            }
        }
    }
    found
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn a_component_has_all_connected_pixels(inside in prop::collection::vec(prop::bool::weighted(0.6), 63..=63)) {
            prop_assume!(inside[31]);
            let mut expected = [false; 63];
            expected[31] = true;
            // As many times as the longest possible path has steps.
            for _ in 0..63 {
                for index in (0..63).filter(|index| inside[*index]) {
                    let is_beside = |other: usize| {
                        (other % 9).abs_diff(index % 9) + (other / 9).abs_diff(index / 9) == 1 && expected[other]
                    };
                    expected[index] |= (0..63).any(is_beside);
                }
            }
            let mut found = flood_fill(31, (9, 7), &mut [false; 63], |index| inside[index]);
            found.sort_unstable();
            prop_assert_eq!(found, (0..63).filter(|index| expected[*index]).collect::<Vec<_>>());
        }
    }

    #[test]
    fn marked_pixels_are_left_out() {
        let mut is_visited = [false, false, true, false];
        assert_eq!(flood_fill(0, (4, 1), &mut is_visited, |_| true), [0, 1]);
        assert_eq!(is_visited, [true, true, true, false]);
    }
}
