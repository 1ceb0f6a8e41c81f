//! Matrix products of strided slices, on the `gemm` crate.
#![allow(unsafe_code)]

/// A matrix in a slice: element (r, c) is `data[r * row_stride + c * column_stride]`.
#[derive(Clone, Copy)]
pub struct Matrix<'a> {
    data: &'a [f32],
    rows: usize,
    columns: usize,
    row_stride: usize,
    column_stride: usize,
}

impl<'a> Matrix<'a> {
    /// A row-major matrix whose rows lie `row_stride` elements apart.
    ///
    /// # Panics
    /// If `data` is too short.
    pub fn new(data: &'a [f32], rows: usize, columns: usize, row_stride: usize) -> Self {
        assert!(
            rows == 0 || columns == 0 || (rows - 1) * row_stride + columns <= data.len(),
            "matrix outside its slice"
        );
        Self { data, rows, columns, row_stride, column_stride: 1 }
    }

    /// The transposed matrix.
    pub fn transposed(self) -> Self {
        Self {
            rows: self.columns,
            columns: self.rows,
            row_stride: self.column_stride,
            column_stride: self.row_stride,
            ..self
        }
    }
}

/// `out = scale · a · b`, or `out += scale · a · b` if `accumulate`; `out` is row-major with rows `out_stride` apart.
/// Runs on the calling thread.
///
/// # Panics
/// If the sizes do not fit.
pub fn multiply(out: &mut [f32], out_stride: usize, a: Matrix, b: Matrix, scale: f32, accumulate: bool) {
    assert_eq!(a.columns, b.rows, "inner sizes");
    assert!(out_stride >= b.columns, "rows of the result overlap");
    if a.rows == 0 || b.columns == 0 {
        return;
    }
    assert!((a.rows - 1) * out_stride + b.columns <= out.len(), "result outside its slice");
    // SAFETY: `Matrix::new` and the assertions above make every element that is read or written lie inside its slice,
    // and `out` is borrowed mutably, so it overlaps neither operand.
    unsafe {
        gemm::gemm(
            a.rows,
            b.columns,
            a.columns,
            out.as_mut_ptr(),
            1,
            out_stride as isize,
            accumulate,
            a.data.as_ptr(),
            a.column_stride as isize,
            a.row_stride as isize,
            b.data.as_ptr(),
            b.column_stride as isize,
            b.row_stride as isize,
            1.0,
            scale,
            false,
            false,
            false,
            gemm::Parallelism::None,
        );
    }
}
