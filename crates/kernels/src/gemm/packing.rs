//! Packing: rearranges the operands of a product into panels. The only packing code in the workspace.

/// Appends panels of `width` rows of a row-major matrix to `panels`; a panel is `[depth, width]`. `rows` yields the
/// `count` rows, each of `depth` elements. The last panel is padded with zeros.
///
/// # Panics
/// If `width` is neither the rows nor the columns of a tile of any [`Instructions`](crate::Instructions).
#[inline(always)]
pub fn pack_rows<'a>(
    mut rows: impl Iterator<Item = &'a [f32]>,
    count: usize,
    depth: usize,
    width: usize,
    panels: &mut Vec<f32>,
) {
    match width {
        4 => pack::<4>(&mut rows, count, depth, panels),
        6 => pack::<6>(&mut rows, count, depth, panels),
        8 => pack::<8>(&mut rows, count, depth, panels),
        16 => pack::<16>(&mut rows, count, depth, panels),
        32 => pack::<32>(&mut rows, count, depth, panels),
        _ => unreachable!("no instructions have tiles of {width}"),
    }
}

#[inline(always)]
fn pack<'a, const WIDTH: usize>(
    rows: &mut impl Iterator<Item = &'a [f32]>,
    count: usize,
    depth: usize,
    panels: &mut Vec<f32>,
) {
    for _ in 0..count.div_ceil(WIDTH) {
        let start = panels.len();
        panels.resize(start + depth * WIDTH, 0.0);
        let panel = panels[start..].as_chunks_mut::<WIDTH>().0;
        for row in 0..WIDTH {
            let Some(values) = rows.next() else { break };
            for (out, value) in panel.iter_mut().zip(values) {
                out[row] = *value;
            }
        }
    }
}

/// Appends panels of `width` columns of a row-major matrix to `panels`; a panel is `[depth, width]`. Every call of
/// `rows` returns an iterator over the `depth` rows, each of `columns` elements. The last panel is padded with zeros.
#[inline(always)]
pub fn pack_columns<'a, I: Iterator<Item = &'a [f32]>>(
    rows: impl Fn() -> I,
    columns: usize,
    width: usize,
    panels: &mut Vec<f32>,
) {
    for start in (0..columns).step_by(width) {
        let count = width.min(columns - start);
        for row in rows() {
            panels.extend_from_slice(&row[start..start + count]);
            panels.resize(panels.len() + width - count, 0.0);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn rows_and_columns_are_transposes() {
        let (height, width) = (7, 9);
        let matrix: Vec<f32> = (1..=height * width).map(|value| value as f32).collect();
        let transposed: Vec<f32> = (0..height * width).map(|i| matrix[i % height * width + i / height]).collect();
        let (mut by_rows, mut by_columns) = (Vec::new(), Vec::new());
        pack_rows(matrix.chunks_exact(width), height, width, 4, &mut by_rows);
        pack_columns(|| transposed.chunks_exact(height), height, 4, &mut by_columns);
        assert_eq!(by_rows, by_columns);
        assert_eq!(by_rows.len(), 8 * width);
        assert_eq!(by_rows[..8], [1.0, 10.0, 19.0, 28.0, 2.0, 11.0, 20.0, 29.0]);
        assert_eq!(by_rows[4 * width..][..4], [37.0, 46.0, 55.0, 0.0]);
    }
}
