//! The dimensions of random numbers: what each is for.

/// The purpose of a random number.
#[derive(Clone, Copy, Debug)]
#[repr(u32)]
pub(crate) enum Dimension {
    FilmX,
    FilmY,
    LensRadius,
    LensAngle,
    Time,
    Surface,
    EmitterU,
    EmitterV,
    EnvironmentU,
    EnvironmentV,
    Lobe,
    DirectionU,
    DirectionV,
    Roulette,
}

impl Dimension {
    /// The dimension of a Sobol sequence at a bounce; None for those that a control variate needs
    /// to be independent of all other paths (`transport/path.rs`).
    pub(super) fn of_sequence(self, bounce: u32) -> Option<u32> {
        // Sets of four that are needed together; what matters most in most scenes comes first, since
        // early dimensions are spread best.
        let of_bounce = |slot: u32| Some(4 * (2 + 2 * bounce) + slot);
        match self {
            Self::FilmX => Some(0),
            Self::FilmY => Some(1),
            Self::EmitterU if bounce == 0 => Some(2),
            Self::EmitterV if bounce == 0 => Some(3),
            Self::LensRadius => Some(4),
            Self::LensAngle => Some(5),
            Self::Time => Some(6),
            Self::DirectionU => of_bounce(0),
            Self::DirectionV => of_bounce(1),
            // With the direction that leads there.
            Self::EmitterU => Some(4 * (2 + 2 * (bounce - 1)) + 2),
            Self::EmitterV => Some(4 * (2 + 2 * (bounce - 1)) + 3),
            Self::Lobe => of_bounce(4),
            Self::Roulette => of_bounce(5),
            Self::EnvironmentU => of_bounce(6),
            Self::EnvironmentV => of_bounce(7),
            Self::Surface => None,
        }
    }
}
