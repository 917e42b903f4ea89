//! Rows of matrices of a few columns, in pieces that stay in registers.

/// Work on some neighbouring columns of a row.
pub(crate) trait Columns {
    /// Does the work for columns `first..first + B`.
    fn piece<const B: usize>(&mut self, first: usize);
}

/// Does the work for all columns of a row. Pieces may overlap, so the work has to set its results
/// rather than to add to them.
#[inline(always)]
pub(crate) fn each_piece(width: usize, work: &mut impl Columns) {
    let mut first = 0;
    while first + 16 <= width {
        work.piece::<16>(first);
        first += 16;
    }
    // Two pieces of eight and one that overlaps cost more than one of sixteen that does.
    if width >= 16 && width - first > 8 {
        return work.piece::<16>(width - 16);
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

/// Defines a function that runs another one compiled for AVX2 with fused products, where the
/// processor has them. Products that are summed go through `f64::mul_add`, which rounds once with
/// or without: same results.
macro_rules! with_fma {
    ($(#[$meta:meta])* $visibility:vis fn $name:ident($($argument:ident: $type:ty),* $(,)?) $(-> $result:ty)? = $portable:path) => {
        $(#[$meta])*
        $visibility fn $name($($argument: $type),*) $(-> $result)? {
            #[cfg(target_arch = "x86_64")]
            {
                #[target_feature(enable = "avx2,fma")]
                unsafe fn wide($($argument: $type),*) $(-> $result)? {
                    $portable($($argument),*)
                }
                if is_x86_feature_detected!("avx2") && is_x86_feature_detected!("fma") {
                    // SAFETY: the processor has the features.
                    return unsafe { wide($($argument),*) };
                }
            }
            $portable($($argument),*)
        }
    };
}
pub(crate) use with_fma;

with_fma! {
    /// Returns `true` if all numbers are finite.
    pub(crate) fn all_finite(x: &[f64]) -> bool = all_finite_portable
}

#[inline(always)]
fn all_finite_portable(x: &[f64]) -> bool {
    // 0 x is zero for a finite x and not a number otherwise.
    let mut sums = [0.0; 16];
    let (pieces, rest) = x.as_chunks::<16>();
    for piece in pieces {
        sums.iter_mut().zip(piece).for_each(|(sum, x)| *sum += 0.0 * x);
    }
    sums.iter().sum::<f64>() + rest.iter().map(|x| 0.0 * x).sum::<f64>() == 0.0
}

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
    fn a_number_that_is_not_finite_is_found_at_any_place() {
        for length in [1, 15, 16, 17, 40] {
            assert!(all_finite(&vec![1e300; length]));
            for (at, bad) in (0..length).zip([f64::NAN, f64::INFINITY, f64::NEG_INFINITY].into_iter().cycle()) {
                let mut numbers = vec![1.0; length];
                numbers[at] = bad;
                assert!(!all_finite(&numbers), "{at} of {length}");
            }
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
