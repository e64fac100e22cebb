//! Colours of the noise beside background noise of several sizes.
//!
//! What is coloured in the innovations depends on how much torque the filter expects: the more it expects, the more of the
//! sensors' own noise it passes on. So a colour belongs to the noise beside which it was estimated, and data whitened with
//! other noise take the colour of the nearest.

use crate::evidence::nuisance::Nuisance;
use crate::evidence::regression::Colour;

/// Colours of each channel of each run.
pub(crate) type Colours = Vec<Vec<Colour>>;

/// Relative difference of two sizes of innovations that changes no answer: that of a standard deviation from 1,000 samples.
const ALIKE: f64 = 0.02;

/// Whether two estimates of the same colours give innovations of the same size.
pub(crate) fn alike(one: &Colours, other: &Colours) -> bool {
    let all = one.iter().flatten().zip(other.iter().flatten());
    all.into_iter().all(|(a, b)| (a.stddev / b.stddev - 1.0).abs() < ALIKE)
}

/// Colours of training and held-out runs, each with the noise beside which they were estimated.
#[derive(Debug, Clone, Default)]
pub(crate) struct Palette {
    entries: Vec<(Nuisance, Colours, Option<Colours>)>,
}

impl Palette {
    /// Adds colours that were estimated beside this noise.
    pub fn add(&mut self, beside: Nuisance, training: Colours, held_out: Option<Colours>) {
        self.entries.push((beside, training, held_out));
    }

    /// Of the training runs, beside noise nearest to this.
    pub fn training(&self, beside: Nuisance) -> Option<&Colours> {
        self.nearest(beside).map(|(_, training, _)| training)
    }

    /// Of the held-out runs, beside noise nearest to this.
    pub fn held_out(&self, beside: Nuisance) -> Option<&Colours> {
        self.nearest(beside).and_then(|(_, _, held_out)| held_out.as_ref())
    }

    /// New colours in the place of those that were estimated beside this noise.
    pub fn replace(&mut self, beside: Nuisance, training: Colours, held_out: Option<Colours>) {
        self.entries.retain(|(own, ..)| *own != beside);
        self.add(beside, training, held_out);
    }

    /// Whether data whitened with noise `of` take the colours that were estimated beside `beside`.
    pub fn is_beside(&self, beside: Nuisance, of: Nuisance) -> bool {
        self.nearest(of).is_some_and(|(own, ..)| *own == beside)
    }

    /// Noise beside which colours were estimated.
    pub fn noise(&self) -> impl Iterator<Item = Nuisance> {
        self.entries.iter().map(|(own, ..)| *own)
    }

    fn nearest(&self, beside: Nuisance) -> Option<&(Nuisance, Colours, Option<Colours>)> {
        self.entries.iter().min_by_key(|(own, ..)| own.steps_to(beside))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_nearest_noise_gives_the_colour() {
        let of_size = |stddev: f64| vec![vec![Colour { stddev, ..Colour::default() }]];
        let mut palette = Palette::default();
        let large = Nuisance { torque: 8, bias: 4, ..Nuisance::default() };
        palette.add(large, of_size(1.2), None);
        palette.add(Nuisance::default(), of_size(1.0), Some(of_size(0.9)));
        let stddev = |colours: Option<&Colours>| colours.map(|c| c[0][0].stddev);
        assert_eq!(stddev(palette.training(Nuisance { torque: 7, ..large })), Some(1.2));
        assert_eq!(stddev(palette.training(Nuisance { torque: 2, ..Nuisance::default() })), Some(1.0));
        assert_eq!(stddev(palette.held_out(Nuisance::default())), Some(0.9));
        assert_eq!(stddev(palette.held_out(large)), None);
        assert!(Palette::default().training(large).is_none());
    }
}
