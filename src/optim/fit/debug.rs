//! `Debug` of a fit shows its length and losses, not each step.

use std::fmt::{Debug, Formatter, Result};

use super::{Evaluation, History};
use crate::debug::tensor;

impl Debug for History {
    fn fmt(&self, f: &mut Formatter<'_>) -> Result {
        let mut all = f.debug_struct("History");
        all.field("steps", &self.rows.len());
        if let (Some(first), Some(last)) = (self.rows.first(), self.rows.last()) {
            all.field("first_loss", &first.loss)
                .field("last_loss", &last.loss)
                .field("seconds", &last.seconds);
        }
        if !self.names.is_empty() {
            all.field("names", &self.names);
        }
        all.finish_non_exhaustive()
    }
}

impl Debug for Evaluation {
    fn fmt(&self, f: &mut Formatter<'_>) -> Result {
        let shown = |(name, image): &(String, _)| (name.clone(), tensor(image));
        let images: Vec<_> = self.images.iter().map(shown).collect();
        f.debug_struct("Evaluation")
            .field("loss", &tensor(&self.loss))
            .field("values", &self.values)
            .field("images", &images)
            .finish()
    }
}
