//! From [`Failure`] to `mobee.MobeeError`.

use crate::failure::Failure;
use pyo3::prelude::*;
use pyo3::sync::PyOnceLock;
use pyo3::types::PyType;

static ERROR: PyOnceLock<Py<PyType>> = PyOnceLock::new();

impl From<Failure> for PyErr {
    fn from(Failure { code, message, place, remedy }: Failure) -> PyErr {
        Python::attach(|py| {
            let raised = ERROR
                .import(py, "mobee._error", "MobeeError")
                .and_then(|class| class.call1((code, message, place, remedy)));
            raised.map_or_else(|e| e, PyErr::from_value)
        })
    }
}
