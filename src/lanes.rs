//! Records of many paths as structures of arrays, so that loops over them become code for several lanes at once.
//!
//! A struct with `#[apply(record!)]` is a [`Record`]: eight of it are [`Record::Lanes`], in which each number is an array.
//! A stage of a path takes and returns records; a loop `for i in 0..LANES { out.set(i, stage(a.get(i))) }` over lanes, in a
//! function that is inlined, is what compilers make vector instructions of, as long as the stage has no calls and no
//! indices that are checked.

/// The records of a structure of arrays.
pub(crate) const LANES: usize = 8;

/// A value of a path that has a form in lanes.
pub(crate) trait Record: Copy {
    type Lanes: Copy + Default;

    /// The value of a lane.
    fn get(lanes: &Self::Lanes, i: usize) -> Self;

    /// Sets the value of a lane.
    fn set(self, lanes: &mut Self::Lanes, i: usize);
}

/// Numbers have an array.
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

/// Makes a struct a [`Record`].
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
                $(pub $field: <$type as crate::lanes::Record>::Lanes,)*
            }

            impl crate::lanes::Record for $name {
                type Lanes = Eight;

                #[inline(always)]
                fn get(lanes: &Eight, i: usize) -> Self {
                    Self {
                        $($field: crate::lanes::Record::get(&lanes.$field, i),)*
                    }
                }

                #[inline(always)]
                fn set(self, lanes: &mut Eight, i: usize) {
                    $(crate::lanes::Record::set(self.$field, &mut lanes.$field, i);)*
                }
            }
        };
    };
}
pub(crate) use lanes;

/// Records of any number of paths, eight in a structure of arrays and then the next eight.
pub(crate) struct Block<T: Record> {
    eights: Vec<T::Lanes>,
}

impl<T: Record> Default for Block<T> {
    fn default() -> Self {
        Self { eights: Vec::new() }
    }
}

impl<T: Record> Block<T> {
    /// Makes room for so many records.
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

    /// The lanes of the record i.
    #[inline(always)]
    pub fn lanes(&self, i: usize) -> &T::Lanes {
        &self.eights[i / LANES]
    }

    #[inline(always)]
    pub fn lanes_mut(&mut self, i: usize) -> &mut T::Lanes {
        &mut self.eights[i / LANES]
    }
}
