//! Parts of a run that were passed in Python: objects, or classes and functions that make one for each life.

use crate::failure::Failure;
use crate::intent::type_name;
use crate::serve::class_name;
use pyo3::prelude::*;
use pyo3::types::{PyDict, PyString};
use std::collections::BTreeMap;

/// Parts of one argument at most.
const MAX_PARTS: usize = 64;

/// The class that parts of one argument derive from.
pub(crate) struct PartBase {
    pub module: &'static str,
    /// Its name in `mobee`.
    pub class: &'static str,
    /// The argument of `mobee.run`.
    pub argument: &'static str,
    /// What the keys of the argument name.
    pub of: &'static str,
}

/// A part that was passed.
pub(crate) struct Given {
    given: Py<PyAny>,
    is_maker: bool,
    pub class: String,
    /// The objects made, with their lives, by what they serve.
    instances: BTreeMap<String, (u32, Py<PyAny>)>,
}

impl PartBase {
    /// Reads an argument: parts by name.
    ///
    /// # Errors
    /// A value that is not such a part, or too many.
    pub fn read(&self, parts: &Bound<'_, PyDict>) -> PyResult<BTreeMap<String, Given>> {
        let base = self.base(parts.py())?;
        let mut all = BTreeMap::new();
        let wrong = |what: String, remedy: String| PyErr::from(Failure::new("type", what, remedy).at(self.argument));
        for (name, given) in parts.iter().take(MAX_PARTS + 1) {
            let Ok(name) = name.cast::<PyString>() else {
                let what = format!("a {}'s name is {}", self.of, type_name(&name));
                return Err(wrong(what, format!("give the names of {}s, as str", self.of)));
            };
            let name = name.to_string_lossy().into_owned();
            let is_part = given.is_instance(&base)?;
            let is_maker = !is_part && given.is_callable();
            if !is_part && !is_maker {
                let what = format!("the {} of {name} is {}", self.class.to_lowercase(), type_name(&given));
                let remedy =
                    format!("give an object of a class that derives from mobee.{}, or such a class", self.class);
                return Err(wrong(what, remedy));
            }
            let class = class_name(&given);
            all.insert(name, Given { given: given.unbind(), is_maker, class, instances: BTreeMap::new() });
        }
        if all.len() > MAX_PARTS {
            let what = format!("too many {}", self.argument);
            return Err(Failure::new("too_many", what, "give fewer").at(self.argument).into());
        }
        Ok(all)
    }

    fn base<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyAny>> {
        py.import(self.module)?.getattr(self.class)
    }
}

impl Given {
    /// The object that serves `part` in this life.
    ///
    /// # Errors
    /// The exception of a class or function that makes it, or another object than such a part.
    pub fn of_life<'py>(
        &mut self,
        py: Python<'py>,
        base: &PartBase,
        part: &str,
        life: u32,
    ) -> PyResult<Bound<'py, PyAny>> {
        if !self.is_maker {
            return Ok(self.given.bind(py).clone());
        }
        if let Some((of, instance)) = self.instances.get(part)
            && *of == life
        {
            return Ok(instance.bind(py).clone());
        }
        let made = self.given.bind(py).call0()?;
        if !made.is_instance(&base.base(py)?)? {
            let what = format!("{} made {}, which is no mobee.{}", self.class, type_name(&made), base.class);
            let remedy = format!("return an object of a class that derives from mobee.{}", base.class);
            return Err(Failure::new("type", what, remedy).into());
        }
        self.instances.insert(part.to_owned(), (life, made.clone().unbind()));
        Ok(made)
    }
}
