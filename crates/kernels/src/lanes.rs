//! Records of many paths as structures of arrays, so that compilers vectorize loops over them.
//!
//! A struct with `#[apply(record!)]` or `#[apply(zeroed!)]` is a [`Record`]. Eight records are stored in
//! [`Record::Lanes`], in which each number is an array. A stage of a path takes and returns records. Compilers turn a
//! loop `for i in 0..LANES { out.set(i, stage(a.get(i))) }` into vector instructions if it is in an inlined function
//! and the stage has no calls and no checked indices.

/// The number of records in a structure of arrays.
pub const LANES: usize = 8;

/// A value of a path that can be stored in lanes.
pub trait Record: Copy {
    type Lanes: Copy + Default;

    /// Returns the value of lane `i` modulo [`LANES`].
    fn get(lanes: &Self::Lanes, i: usize) -> Self;

    /// Sets the value of lane `i` modulo [`LANES`].
    fn set(self, lanes: &mut Self::Lanes, i: usize);
}

/// Implements [`Record`] for numbers, which are stored in arrays.
macro_rules! arrays {
    ($($number:ty),*) => {
        $(
            impl Record for $number {
                type Lanes = [Self; LANES];

                #[inline(always)]
                fn get(lanes: &Self::Lanes, i: usize) -> Self {
                    lanes[i % LANES]
                }

                #[inline(always)]
                fn set(self, lanes: &mut Self::Lanes, i: usize) {
                    lanes[i % LANES] = self;
                }
            }
        )*
    };
}

arrays!(f32, u32, bool);

/// Implements [`Record`] for a struct.
#[macro_export]
#[doc(hidden)]
macro_rules! lanes {
    (
        $(#[$meta:meta])*
        $vis:vis struct $name:ident {
            $($(#[$of_field:meta])* $field_vis:vis $field:ident: $type:ty),* $(,)?
        }
    ) => {
        const _: () = {
            #[derive(Clone, Copy, Default)]
            pub struct Eight {
                $(pub $field: <$type as $crate::lanes::Record>::Lanes,)*
            }

            impl $crate::lanes::Record for $name {
                type Lanes = Eight;

                #[inline(always)]
                fn get(lanes: &Eight, i: usize) -> Self {
                    Self {
                        $($field: $crate::lanes::Record::get(&lanes.$field, i),)*
                    }
                }

                #[inline(always)]
                fn set(self, lanes: &mut Eight, i: usize) {
                    $($crate::lanes::Record::set(self.$field, &mut lanes.$field, i);)*
                }
            }
        };
    };
}

/// Records of any number of paths, stored in structures of arrays of eight records each.
pub struct Block<T: Record> {
    eights: Vec<T::Lanes>,
}

impl<T: Record> Default for Block<T> {
    fn default() -> Self {
        Self { eights: Vec::new() }
    }
}

impl<T: Record> Block<T> {
    /// Makes room for `len` records.
    #[inline(always)]
    pub fn reserve(&mut self, len: usize) {
        let eights = len.div_ceil(LANES);
        if self.eights.len() < eights {
            self.eights.resize(eights, T::Lanes::default());
        }
    }

    #[inline(always)]
    pub fn get(&self, i: usize) -> T {
        T::get(&self.eights[i / LANES], i)
    }

    #[inline(always)]
    pub fn set(&mut self, i: usize, value: T) {
        value.set(&mut self.eights[i / LANES], i);
    }

    /// Returns the lanes that contain record `i`.
    #[inline(always)]
    pub fn lanes(&self, i: usize) -> &T::Lanes {
        &self.eights[i / LANES]
    }

    #[inline(always)]
    pub fn lanes_mut(&mut self, i: usize) -> &mut T::Lanes {
        &mut self.eights[i / LANES]
    }
}
