//! Complaints as diagnostics of `miette`.

use super::{Complaint, Complaints, ConfigError};
use miette::{Diagnostic, LabeledSpan, Severity, SourceCode};
use std::fmt;

impl Complaint {
    fn diagnostic(&self) -> &(dyn Diagnostic + 'static) {
        match self {
            Complaint::Config(e) => e,
            Complaint::Model(e) => e,
        }
    }
}

impl Diagnostic for ConfigError {
    fn help<'a>(&'a self) -> Option<Box<dyn fmt::Display + 'a>> {
        (!self.help_text().is_empty()).then(|| Box::new(self.help_text()) as Box<dyn fmt::Display>)
    }

    fn source_code(&self) -> Option<&dyn SourceCode> {
        self.excerpt().map(|place| place as &dyn SourceCode)
    }

    fn labels(&self) -> Option<Box<dyn Iterator<Item = LabeledSpan> + '_>> {
        let span = self.excerpt()?.place();
        Some(Box::new(std::iter::once(LabeledSpan::new(Some("here".into()), span.start, span.len().max(1)))))
    }
}

impl Diagnostic for Complaints {
    fn severity(&self) -> Option<Severity> {
        self.only()?.diagnostic().severity()
    }
    fn help<'a>(&'a self) -> Option<Box<dyn fmt::Display + 'a>> {
        self.only()?.diagnostic().help()
    }
    fn source_code(&self) -> Option<&dyn SourceCode> {
        self.only()?.diagnostic().source_code()
    }
    fn labels(&self) -> Option<Box<dyn Iterator<Item = LabeledSpan> + '_>> {
        self.only()?.diagnostic().labels()
    }
    fn related<'a>(&'a self) -> Option<Box<dyn Iterator<Item = &'a dyn Diagnostic> + 'a>> {
        match self.only() {
            Some(_) => None,
            None => Some(Box::new(self.iter().map(|c| c.diagnostic() as &dyn Diagnostic))),
        }
    }
}
