//! Rows of matrices of a few columns, in pieces that stay in registers.

/// Work on some neighbouring columns of a row.
pub(crate) trait Columns {
    /// Does the work for columns `first..first + B`.
    fn piece<const B: usize>(&mut self, first: usize);
}

/// Does the work for all columns of a row. Pieces may overlap, so the work has to set its results rather than to add to them.
#[inline(always)]
pub(crate) fn each_piece(width: usize, work: &mut impl Columns) {
    let mut first = 0;
    while first + 16 <= width {
        work.piece::<16>(first);
        first += 16;
    }
    if first + 8 <= width {
        work.piece::<8>(first);
        first += 8;
    }
    match width - first {
        0 => {}
        rest if rest > 4 && width >= 8 => work.piece::<8>(width - 8),
        rest if rest <= 4 && width >= 4 => work.piece::<4>(width - 4),
        rest => {
            if rest >= 4 {
                work.piece::<4>(first);
                first += 4;
            }
            (first..width).for_each(|at| work.piece::<1>(at));
        }
    }
}

/// Defines a function that runs another one compiled for AVX2, where the processor has that. Products are rounded before they are summed: same results.
macro_rules! with_avx2 {
    ($(#[$meta:meta])* $visibility:vis fn $name:ident($($argument:ident: $type:ty),* $(,)?) = $portable:path) => {
        $(#[$meta])*
        $visibility fn $name($($argument: $type),*) {
            #[cfg(target_arch = "x86_64")]
            {
                #[target_feature(enable = "avx2")]
                unsafe fn wide($($argument: $type),*) {
                    $portable($($argument),*)
                }
                if is_x86_feature_detected!("avx2") {
                    // SAFETY: the processor has the feature.
                    return unsafe { wide($($argument),*) };
                }
            }
            $portable($($argument),*)
        }
    };
}
pub(crate) use with_avx2;

#[cfg(test)]
mod tests {
    use super::*;

    struct Marks(Vec<u32>);

    impl Columns for Marks {
        fn piece<const B: usize>(&mut self, first: usize) {
            self.0[first..first + B].iter_mut().for_each(|mark| *mark = 1);
        }
    }

    #[test]
    fn pieces_cover_every_width() {
        for width in 0..70 {
            let mut marks = Marks(vec![0; width]);
            each_piece(width, &mut marks);
            assert!(marks.0.iter().all(|&mark| mark == 1), "{width}");
        }
    }
}
