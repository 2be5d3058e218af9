//! Arrays from and to Python: shape, type and size are checked here, whatever comes.

use crate::failure::Failure;
use crate::joints::JointTable;
use numpy::{
    Element, PyArray, PyArrayDescrMethods, PyArrayDyn, PyArrayMethods, PyUntypedArray, PyUntypedArrayMethods, ndarray,
};
use pyo3::prelude::*;
use pyo3::types::{PyDict, PyType};

/// The most numbers of an array that is given, and of one that is returned: 2 GiB.
const MAX_NUMBERS: usize = 1 << 28;
/// No more of a foreign exception is repeated, characters.
const MAX_QUOTED: usize = 200;

/// Rows of numbers: one row if `single`.
pub(crate) struct Rows<'py> {
    array: Bound<'py, PyArrayDyn<f64>>,
    /// Number of rows.
    pub rows: usize,
    width: usize,
    /// True for one row of shape `(width,)`, false for a batch.
    pub single: bool,
}

impl<'py> Rows<'py> {
    /// Configurations `(dof,)` or `(N, dof)`.
    ///
    /// # Errors
    /// Another shape or type, or too many.
    pub fn configurations(what: &str, value: &Bound<'py, PyAny>, joints: &JointTable) -> PyResult<Self> {
        let array = numbers(what, value)?;
        let width = joints.len();
        let (rows, single) = match *array.shape() {
            [n] if n == width => (1, true),
            [rows, n] if n == width => (rows, false),
            ref shape => {
                let message = format!("{what} has shape {}", shape_text(shape));
                let remedy = format!(
                    "give ({width},) for one configuration or (N, {width}) for a batch; {}",
                    joints.description()
                );
                return Err(Failure::new("shape", message, remedy).at(what).into());
            }
        };
        Ok(Self { array, rows, width, single })
    }

    /// Copies rows into a buffer. The array may have been changed by others since it was checked, but not made shorter.
    pub fn load(&self, from: usize, count: usize, buffer: &mut Vec<f64>) -> PyResult<()> {
        let view = self.array.try_readonly().map_err(|e| changed(&e.to_string()))?;
        let all = view.as_slice().map_err(|e| changed(&e.to_string()))?;
        let range = from * self.width..(from + count) * self.width;
        buffer.extend_from_slice(all.get(range).ok_or_else(|| changed("it is shorter now"))?);
        Ok(())
    }
}

fn changed(why: &str) -> PyErr {
    let message = format!("the array changed during the call: {why}");
    Failure::new("array", message, "give each thread its own array").into()
}

/// An array of a fixed shape, in row order.
///
/// # Errors
/// Another shape or type.
pub(crate) fn fixed<const N: usize>(
    what: &str,
    value: &Bound<'_, PyAny>,
    shape: &[usize],
    remedy: &str,
) -> PyResult<[f64; N]> {
    let array = numbers(what, value)?;
    if array.shape() != shape {
        let message = format!("{what} has shape {}", shape_text(array.shape()));
        return Err(Failure::new("shape", message, remedy).at(what).into());
    }
    let view = array.try_readonly().map_err(|e| changed(&e.to_string()))?;
    let all = view.as_slice().map_err(|e| changed(&e.to_string()))?;
    <[f64; N]>::try_from(all).map_err(|e| changed(&e.to_string()))
}

/// A row of finite numbers.
///
/// # Errors
/// Another shape or type, or numbers that are not finite.
pub(crate) fn vector(what: &str, value: &Bound<'_, PyAny>, width: usize, remedy: &str) -> PyResult<Vec<f64>> {
    let array = numbers(what, value)?;
    if array.shape() != [width] {
        let message = format!("it has shape {}", shape_text(array.shape()));
        return Err(Failure::new("shape", message, remedy).at(what).into());
    }
    let view = array.try_readonly().map_err(|e| changed(&e.to_string()))?;
    let all = view.as_slice().map_err(|e| changed(&e.to_string()))?.to_vec();
    if let Some((i, x)) = all.iter().enumerate().find(|(_, x)| !x.is_finite()) {
        let message = format!("number {i} is {x}");
        return Err(Failure::new("not_finite", message, "give finite numbers").at(what).into());
    }
    Ok(all)
}

/// Rows of three numbers, at most `most` of them.
///
/// # Errors
/// Another shape or type, too many, or numbers that are not finite.
pub(crate) fn points(what: &str, value: &Bound<'_, PyAny>, most: usize) -> PyResult<Vec<[f64; 3]>> {
    let array = numbers(what, value)?;
    let [rows, 3] = *array.shape() else {
        let message = format!("{what} has shape {}", shape_text(array.shape()));
        return Err(Failure::new("shape", message, "give an array (N, 3)").at(what).into());
    };
    if rows > most {
        let message = format!("{what} has {rows} rows");
        return Err(Failure::new("too_many", message, format!("give {most} at most")).at(what).into());
    }
    let view = array.try_readonly().map_err(|e| changed(&e.to_string()))?;
    let all = view.as_slice().map_err(|e| changed(&e.to_string()))?;
    if all.iter().any(|x| !x.is_finite()) {
        return Err(Failure::new("not_finite", format!("{what} is not finite"), "give finite numbers").at(what).into());
    }
    Ok(all.chunks_exact(3).filter_map(|p| p.try_into().ok()).collect())
}

/// A C-contiguous, aligned array of float64 from anything that NumPy takes for real numbers.
fn numbers<'py>(what: &str, value: &Bound<'py, PyAny>) -> PyResult<Bound<'py, PyArrayDyn<f64>>> {
    if let Ok(array) = value.cast_exact::<PyArrayDyn<f64>>()
        && is_plain(array)
    {
        return checked_size(what, array.clone());
    }
    let py = value.py();
    let numpy = py.import("numpy")?;
    let masked = numpy.getattr("ma")?.getattr("MaskedArray")?;
    if value.is_instance(masked.cast::<PyType>()?)? {
        let remedy = "fill or drop what is masked, by q.filled(0.0) or q.compressed()";
        return Err(Failure::new("dtype", format!("{what} is a masked array"), remedy).at(what).into());
    }
    let array = numpy.call_method1("asarray", (value,)).map_err(|e| foreign(what, value, e))?;
    let array = array.cast_into::<PyUntypedArray>().map_err(PyErr::from)?;
    let dtype = array.dtype();
    if !(matches!(dtype.kind(), b'f' | b'i' | b'u') && dtype.itemsize() <= 8) {
        let message = format!("{what} has dtype {dtype}, from {}", type_name(value));
        let remedy = "give real numbers, best an array of dtype float64";
        return Err(Failure::new("dtype", message, remedy).at(what).into());
    }
    if array.len() > MAX_NUMBERS {
        return Err(too_many(what, array.len()).into());
    }
    let options = PyDict::new(py);
    options.set_item("dtype", "float64")?;
    options.set_item("requirements", ["C", "A"])?;
    let array = numpy.call_method("require", (array,), Some(&options)).map_err(|e| foreign(what, value, e))?;
    checked_size(what, array.cast_into::<PyArrayDyn<f64>>().map_err(PyErr::from)?)
}

/// Tests that the numbers can be read in place.
fn is_plain(array: &Bound<'_, PyArrayDyn<f64>>) -> bool {
    array.is_c_contiguous() && array.data().is_aligned()
}

fn checked_size<'py>(what: &str, array: Bound<'py, PyArrayDyn<f64>>) -> PyResult<Bound<'py, PyArrayDyn<f64>>> {
    if array.len() > MAX_NUMBERS { Err(too_many(what, array.len()).into()) } else { Ok(array) }
}

fn too_many(what: &str, numbers: usize) -> Failure {
    let message = format!("{what} has {numbers} numbers, and {MAX_NUMBERS} are taken at once");
    Failure::new("too_many", message, "split the batch").at(what)
}

/// An exception of NumPy, or of the object that it read. What is no error (Ctrl-C, exit) goes on as it is.
fn foreign(what: &str, value: &Bound<'_, PyAny>, e: PyErr) -> PyErr {
    let py = value.py();
    if !e.is_instance_of::<pyo3::exceptions::PyException>(py) || e.is_instance_of::<pyo3::exceptions::PyMemoryError>(py)
    {
        return e;
    }
    let text: String =
        e.value(py).str().map(|s| s.to_string_lossy().chars().take(MAX_QUOTED).collect()).unwrap_or_default();
    let message = format!("{what} is no array of numbers, but {}: {text}", type_name(value));
    Failure::new("dtype", message, "give real numbers, best an array of dtype float64").at(what).into()
}

fn type_name(value: &Bound<'_, PyAny>) -> String {
    value.get_type().name().map(|name| name.to_string_lossy().chars().take(MAX_QUOTED).collect()).unwrap_or_default()
}

fn shape_text(shape: &[usize]) -> String {
    match shape {
        [n] => format!("({n},)"),
        many => format!("({})", many.iter().map(usize::to_string).collect::<Vec<_>>().join(", ")),
    }
}

/// An empty vector with room for `rows * each` numbers; a failure if there is no memory for it.
pub(crate) fn reserved<T>(rows: usize, each: usize) -> Result<Vec<T>, Failure> {
    let (mut all, numbers) = (Vec::new(), rows.saturating_mul(each));
    if numbers > MAX_NUMBERS {
        let message = format!("the answer would have {numbers} numbers, and {MAX_NUMBERS} are returned at once");
        return Err(Failure::new("too_many", message, "split the batch"));
    }
    let memory = |_| Failure::new("memory", format!("there is no memory for {numbers} numbers"), "split the batch");
    all.try_reserve_exact(numbers).map_err(memory)?;
    Ok(all)
}

/// An array of a shape from its numbers in row order.
pub(crate) fn array<'py, T: Element>(
    py: Python<'py>,
    all: Vec<T>,
    shape: &[usize],
) -> PyResult<Bound<'py, PyArrayDyn<T>>> {
    let all = ndarray::ArrayD::from_shape_vec(shape, all).map_err(|e| {
        Failure::new(
            "internal",
            format!("the answer has another shape: {e}"),
            "this is a bug of mobee: please report it",
        )
    })?;
    Ok(PyArray::from_owned_array(py, all))
}
