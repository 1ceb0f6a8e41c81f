//! NumPy arrays: input is checked and copied, output is moved.
//!
//! Input is copied because other Python threads may write to an array while the GIL is released.

use crate::errors::value_error;
use numpy::{
    Element, PyArray1, PyArray2, PyArray3, PyArrayDescrMethods, PyArrayMethods, PyUntypedArray, PyUntypedArrayMethods,
    dtype,
};
use pyo3::exceptions::{PyTypeError, PyValueError};
use pyo3::prelude::*;
use splatseg::dataset::DatasetSettings;
use splatseg::geometry::MAX_SEGMENT_ID;
use splatseg::{Image, Mask};

/// Requires a C-contiguous array of a shape. `types` and `shape` describe it in errors.
fn checked<'py>(
    value: &Bound<'py, PyAny>,
    name: &str,
    types: &str,
    shape: &str,
    fits: impl Fn(&[usize]) -> bool,
) -> PyResult<Bound<'py, PyUntypedArray>> {
    let expected = format!("expected a NumPy array of {types} with shape {shape}");
    refuse_masked(value, name)?;
    let Ok(array) = value.cast::<PyUntypedArray>() else {
        let found = value.get_type().name()?;
        return Err(PyTypeError::new_err(format!("{name} is of type {found}, {expected}")));
    };
    if !fits(array.shape()) {
        return Err(PyValueError::new_err(format!("{name} has shape {}, {expected}", shape_text(array.shape()))));
    }
    if !array.is_c_contiguous() {
        let strides = array.strides();
        return Err(PyValueError::new_err(format!(
            "{name} is not contiguous (strides {strides:?}), {expected} in C order: pass np.ascontiguousarray({name})"
        )));
    }
    Ok(array.clone())
}

/// Refuses NumPy's masked arrays: their data has values where they are masked.
fn refuse_masked(value: &Bound<'_, PyAny>, name: &str) -> PyResult<()> {
    let py = value.py();
    if value.get_type().is(py.get_type::<PyUntypedArray>()) {
        return Ok(());
    }
    let masked = py.import("numpy.ma")?.getattr("MaskedArray")?;
    if !value.is_instance(&masked)? {
        return Ok(());
    }
    // Some names are descriptions.
    let array = if name.contains(' ') { "array" } else { name };
    Err(PyTypeError::new_err(format!("{name} is a masked array, whose mask would be lost: pass {array}.filled(0)")))
}

fn shape_text(shape: &[usize]) -> String {
    match shape {
        [only] => format!("({only},)"),
        sizes => format!("({})", sizes.iter().map(ToString::to_string).collect::<Vec<_>>().join(", ")),
    }
}

/// The `TypeError` for an array of the wrong type.
fn wrong_type(array: &Bound<'_, PyUntypedArray>, name: &str, types: &str, shape: &str) -> PyErr {
    PyTypeError::new_err(format!(
        "{name} is an array of {}, expected a NumPy array of {types} with shape {shape}",
        array.dtype()
    ))
}

fn is_of<T: Element>(array: &Bound<'_, PyUntypedArray>) -> bool {
    array.dtype().is_equiv_to(&dtype::<T>(array.py()))
}

/// The pixels of a two-dimensional array of `T`, and its size `(width, height)`.
fn pixels<T: Element + Copy>(array: &Bound<'_, PyUntypedArray>) -> PyResult<(Vec<T>, (usize, usize))> {
    let array = array.cast::<PyArray2<T>>()?.try_readonly().map_err(value_error)?;
    let &[height, width] = array.shape() else { return Err(value_error("not two-dimensional")) };
    Ok((array.as_slice().map_err(value_error)?.to_vec(), (width, height)))
}

fn image<T: Clone>((pixels, (width, height)): (Vec<T>, (usize, usize))) -> PyResult<Image<T>> {
    Image::from_pixels(width, height, pixels).map_err(value_error)
}

/// True if a shape is that of a non-empty single-channel image.
fn is_image(shape: &[usize]) -> bool {
    matches!(shape, [height, width] if *height > 0 && *width > 0)
}

/// A colour image: uint8, `(height, width, 3)`.
pub fn color_image(value: &Bound<'_, PyAny>, name: &str) -> PyResult<Image<[u8; 3]>> {
    const SHAPE: &str = "(height, width, 3)";
    let is_color = |shape: &[usize]| shape.len() == 3 && shape[2] == 3 && shape[0] > 0 && shape[1] > 0;
    let array = checked(value, name, "uint8", SHAPE, is_color)?;
    if !is_of::<u8>(&array) {
        return Err(wrong_type(&array, name, "uint8", SHAPE));
    }
    let (height, width) = (array.shape()[0], array.shape()[1]);
    let array = array.cast::<PyArray3<u8>>()?.try_readonly().map_err(value_error)?;
    let bytes = array.as_slice().map_err(value_error)?;
    image((bytes.as_chunks().0.to_vec(), (width, height)))
}

/// Depth whose median is above this is not in metres, unless `depth_scale` says so: no depth camera measures 100 m, and none
/// measures 100 mm.
const MAX_MEDIAN_DEPTH_M: f64 = 100.0;

/// Depth above this is none, metres: renderers write 1e10 where they see nothing.
const MAX_DEPTH_M: f64 = 1e5;

/// Refuses depth of floats that are probably millimetres.
fn require_metres(pixels: impl Iterator<Item = f64>) -> PyResult<()> {
    match median_of_other_unit(pixels) {
        None => Ok(()),
        Some(median) => Err(value_error(format!(
            "depth has a median of {median:.0}, expected metres: pass depth_scale=1000 if it is in millimetres, \
             or depth_scale=1 if it really is in metres"
        ))),
    }
}

/// The median of depth, if it is too large for metres.
pub fn median_of_other_unit(pixels: impl Iterator<Item = f64>) -> Option<f64> {
    let mut measured: Vec<f64> = pixels.filter(|depth| *depth > 0.0 && *depth < MAX_DEPTH_M).collect();
    if measured.is_empty() {
        return None;
    }
    let middle = measured.len() / 2;
    let (_, median, _) = measured.select_nth_unstable_by(middle, f64::total_cmp);
    (*median > MAX_MEDIAN_DEPTH_M).then_some(*median)
}

/// A depth image in metres: float32 or float64 metres, or, with `depth_scale` units per metre, uint16.
pub fn depth_image(value: &Bound<'_, PyAny>, depth_scale: Option<f64>) -> PyResult<Image<f32>> {
    const TYPES: &str = "float32 metres (or uint16, with depth_scale in units per metre)";
    const SHAPE: &str = "(height, width)";
    let array = checked(value, "depth", TYPES, SHAPE, is_image)?;
    let scales = DatasetSettings::DEPTH_SCALES;
    if let Some(scale) = depth_scale.filter(|scale| !scales.accepts_number(*scale)) {
        return Err(value_error(format!("depth_scale is {scale}, expected {scales} units per metre, e.g. 1000")));
    }
    let scale = depth_scale.unwrap_or(1.0);
    if is_of::<f32>(&array) {
        let (mut pixels, size) = pixels::<f32>(&array)?;
        if depth_scale.is_none() {
            require_metres(pixels.iter().map(|depth| f64::from(*depth)))?;
        } else {
            pixels.iter_mut().for_each(|depth| *depth = (f64::from(*depth) / scale) as f32);
        }
        return image((pixels, size));
    }
    if is_of::<f64>(&array) {
        let (pixels, size) = pixels::<f64>(&array)?;
        if depth_scale.is_none() {
            require_metres(pixels.iter().copied())?;
        }
        return image((pixels.into_iter().map(|depth| (depth / scale) as f32).collect(), size));
    }
    if is_of::<u16>(&array) && depth_scale.is_some() {
        let (pixels, size) = pixels::<u16>(&array)?;
        // The same arithmetic as for depth images of data sets.
        return image((pixels.into_iter().map(|depth| f32::from(depth) / scale as f32).collect(), size));
    }
    Err(wrong_type(&array, "depth", TYPES, SHAPE))
}

/// An image of ids: any integers up to 16777215, `(height, width)`.
pub fn id_image(value: &Bound<'_, PyAny>, name: &str) -> PyResult<Image<u32>> {
    const TYPES: &str = "integers";
    const SHAPE: &str = "(height, width)";
    let array = checked(value, name, TYPES, SHAPE, is_image)?;
    macro_rules! read {
        ($($kind:ty),*) => {
            $(if is_of::<$kind>(&array) {
                let (pixels, size) = pixels::<$kind>(&array)?;
                return image((ids(pixels, name)?, size));
            })*
        };
    }
    read!(u8, u16, u32, u64, i8, i16, i32, i64);
    Err(wrong_type(&array, name, TYPES, SHAPE))
}

fn ids<T: Copy + TryInto<u32> + std::fmt::Display>(pixels: Vec<T>, name: &str) -> PyResult<Vec<u32>> {
    let id = |pixel: T| match pixel.try_into() {
        Ok(id) if id <= MAX_SEGMENT_ID => Ok(id),
        _ => Err(value_error(format!("{name} has the id {pixel}, expected 0 to {MAX_SEGMENT_ID}"))),
    };
    pixels.into_iter().map(id).collect()
}

/// One mask: bool, `(height, width)`.
pub fn mask_image(value: &Bound<'_, PyAny>, name: &str) -> PyResult<Image<bool>> {
    const SHAPE: &str = "(height, width)";
    let array = checked(value, name, "bool", SHAPE, is_image)?;
    if !is_of::<bool>(&array) {
        return Err(wrong_type(&array, name, "bool", SHAPE));
    }
    image(pixels::<bool>(&array)?)
}

/// The result of a segmenter, by its form.
pub enum Masks {
    /// `(masks, height, width)`, with the size `(width, height)` of each.
    Stack(Vec<bool>, (usize, usize)),
    /// An image of ids.
    Ids(Image<u32>),
}

/// Masks: bool, `(masks, height, width)`, or an image of ids.
pub fn masks(value: &Bound<'_, PyAny>, name: &str) -> PyResult<Masks> {
    const TYPES: &str = "bool";
    const SHAPE: &str = "(masks, height, width), or an id image of integers with shape (height, width)";
    let is_masks = |shape: &[usize]| is_image(shape) || shape.len() == 3;
    let array = checked(value, name, TYPES, SHAPE, is_masks)?;
    if array.shape().len() == 2 {
        if is_of::<bool>(&array) {
            return Err(wrong_type(
                &array,
                name,
                "integers",
                "(height, width) or bool masks with shape (masks, height, width)",
            ));
        }
        return Ok(Masks::Ids(id_image(value, name)?));
    }
    if !is_of::<bool>(&array) {
        return Err(wrong_type(&array, name, TYPES, SHAPE));
    }
    let size = (array.shape()[2], array.shape()[1]);
    let array = array.cast::<PyArray3<bool>>()?.try_readonly().map_err(value_error)?;
    Ok(Masks::Stack(array.as_slice().map_err(value_error)?.to_vec(), size))
}

/// Numbers in a list, tuple or array of any numeric type.
pub fn numbers(value: &Bound<'_, PyAny>, name: &str, shape: &[usize], meaning: &str) -> PyResult<Vec<f64>> {
    let expected = format!("expected {meaning} with shape {}", shape_text(shape));
    let wrong_type = || {
        let found = value.get_type().name().map_or_else(|_| "unknown".to_owned(), |name| name.to_string());
        PyTypeError::new_err(format!("{name} is of type {found}, {expected}"))
    };
    refuse_masked(value, name)?;
    // NumPy would convert None to NaN.
    if value.is_none() {
        return Err(wrong_type());
    }
    let numpy = value.py().import("numpy")?;
    let array = numpy.call_method1("ascontiguousarray", (value, "float64")).map_err(|_| wrong_type())?;
    let array = array.cast::<PyUntypedArray>().map_err(value_error)?;
    // ascontiguousarray turns a number into an array of one.
    let found =
        value.getattr("shape").and_then(|shape| shape.extract::<Vec<usize>>()).unwrap_or(array.shape().to_vec());
    if found != shape {
        return Err(value_error(format!("{name} has shape {}, {expected}", shape_text(&found))));
    }
    let flat = array.call_method1("reshape", (-1,))?;
    let numbers =
        flat.cast::<PyArray1<f64>>()?.try_readonly().map_err(value_error)?.as_slice().map_err(value_error)?.to_vec();
    match numbers.iter().find(|number| !number.is_finite()) {
        Some(number) => Err(value_error(format!("{name} contains {number}, {expected} of finite numbers"))),
        None => Ok(numbers),
    }
}

/// Numbers from 0 to 1. Those that rounding has put just outside are 0 or 1.
pub fn fractions(value: &Bound<'_, PyAny>, name: &str, shape: &[usize], meaning: &str) -> PyResult<Vec<f64>> {
    const ROUNDING: f64 = 1e-6;
    let mut found = numbers(value, name, shape, meaning)?;
    for number in &mut found {
        if !(-ROUNDING..=1.0 + ROUNDING).contains(number) {
            return Err(value_error(format!("{name} contains {number}, expected 0 to 1")));
        }
        *number = number.clamp(0.0, 1.0);
    }
    Ok(found)
}

/// Converts an image to an array `(height, width)`, reusing its memory.
pub fn to_array<T: Element + Clone>(py: Python<'_>, image: Image<T>) -> PyResult<Py<PyArray2<T>>> {
    let (width, height) = image.size();
    Ok(PyArray1::from_vec(py, image.into_pixels()).reshape([height, width])?.unbind())
}

/// Copies pixels to an array `(height, width)`.
pub fn to_plain_array<T: Element + Copy>(
    py: Python<'_>,
    pixels: &[T],
    (width, height): (usize, usize),
) -> PyResult<Py<PyArray2<T>>> {
    Ok(PyArray1::from_slice(py, pixels).reshape([height, width])?.unbind())
}

/// Copies colours to an array `(height, width, 3)`.
pub fn to_color_array(
    py: Python<'_>,
    pixels: &[[u8; 3]],
    (width, height): (usize, usize),
) -> PyResult<Py<PyArray3<u8>>> {
    Ok(PyArray1::from_slice(py, pixels.as_flattened()).reshape([height, width, 3])?.unbind())
}

/// Rows of numbers as an array `(rows, N)`.
pub fn to_rows<T: Element + Copy, const N: usize>(
    py: Python<'_>,
    rows: impl Iterator<Item = [T; N]>,
) -> PyResult<Py<PyArray2<T>>> {
    let flat: Vec<T> = rows.flatten().collect();
    let count = flat.len() / N;
    Ok(PyArray1::from_vec(py, flat).reshape([count, N])?.unbind())
}

/// Masks as an array `(masks, height, width)`.
pub fn to_masks<'m>(
    py: Python<'_>,
    masks: impl Iterator<Item = &'m Mask>,
    (width, height): (usize, usize),
) -> PyResult<Py<PyArray3<bool>>> {
    let (mut pixels, mut count) = (Vec::new(), 0);
    for mask in masks {
        let start = pixels.len();
        pixels.resize(start + width * height, false);
        mask.pixel_indices().for_each(|index| pixels[start + index] = true);
        count += 1;
    }
    Ok(PyArray1::from_vec(py, pixels).reshape([count, height, width])?.unbind())
}
