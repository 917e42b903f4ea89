//! Colours that print and that the colour-blind tell apart.

use super::drawing::Colour;

/// The qualitative colours of M. Okabe and K. Ito, Color Universal Design (2008), without yellow,
/// which is lost on white; darkest contrasts first.
pub(super) const CURVES: [Colour; 8] = [BLUE, VERMILION, GREEN, ORANGE, PURPLE, SKY, INK, Colour(120, 120, 120)];
/// Blue of that palette; so the following.
pub(super) const BLUE: Colour = Colour(0, 114, 178);
/// Vermilion.
pub(super) const VERMILION: Colour = Colour(213, 94, 0);
/// Bluish green.
pub(super) const GREEN: Colour = Colour(0, 158, 115);
/// Orange.
pub(super) const ORANGE: Colour = Colour(230, 159, 0);
/// Reddish purple.
pub(super) const PURPLE: Colour = Colour(204, 121, 167);
/// Sky blue.
pub(super) const SKY: Colour = Colour(86, 180, 233);
/// Text.
pub(super) const INK: Colour = Colour(30, 30, 30);
/// Text of less weight.
pub(super) const GREY: Colour = Colour(105, 105, 105);
/// Axes.
pub(super) const AXIS: Colour = Colour(140, 140, 140);
/// Lines behind curves.
pub(super) const GRID: Colour = Colour(228, 228, 228);

/// Bands behind curves: pale, so that the curves' colours stay what they are.
/// The first phase, in which most plants rest, is grey.
const BANDS: [Colour; 6] = [Colour(190, 190, 190), ORANGE, SKY, PURPLE, Colour(240, 228, 66), GREEN];

/// The pale colour of the band of that number.
pub(super) fn band(index: usize) -> Colour {
    let share = if (index / BANDS.len()).is_multiple_of(2) { 0.22 } else { 0.42 };
    paler(BANDS[index % BANDS.len()], share)
}

/// A share of a colour on white.
pub(super) fn paler(colour: Colour, share: f64) -> Colour {
    let mix = |c: u8| (255.0 - share * (255.0 - f64::from(c))).round() as u8;
    Colour(mix(colour.0), mix(colour.1), mix(colour.2))
}

/// Nine stops of viridis (S. van der Walt and N. Smith, 2015): even steps of lightness.
const VIRIDIS: [Colour; 9] = [
    Colour(68, 1, 84),
    Colour(71, 44, 122),
    Colour(59, 81, 139),
    Colour(44, 113, 142),
    Colour(33, 144, 141),
    Colour(39, 173, 129),
    Colour(92, 200, 99),
    Colour(170, 220, 50),
    Colour(253, 231, 37),
];

/// Viridis at a share from 0 to 1; what is not a number is grey.
pub(super) fn viridis(share: f64) -> Colour {
    if share.is_nan() {
        return Colour(200, 200, 200);
    }
    let place = share.clamp(0.0, 1.0) * (VIRIDIS.len() - 1) as f64;
    let below = (place as usize).min(VIRIDIS.len() - 2);
    let (a, b, part) = (VIRIDIS[below], VIRIDIS[below + 1], place - below as f64);
    let mix = |a: u8, b: u8| (f64::from(a) + part * (f64::from(b) - f64::from(a))).round() as u8;
    Colour(mix(a.0, b.0), mix(a.1, b.1), mix(a.2, b.2))
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Relative luminance after IEC 61966-2-1.
    fn luminance(colour: Colour) -> f64 {
        let linear = |c: u8| {
            let c = f64::from(c) / 255.0;
            if c <= 0.040_45 { c / 12.92 } else { ((c + 0.055) / 1.055).powf(2.4) }
        };
        0.2126 * linear(colour.0) + 0.7152 * linear(colour.1) + 0.0722 * linear(colour.2)
    }

    #[test]
    fn the_colour_map_becomes_lighter_all_along() {
        let shades: Vec<f64> = (0..=100).map(|i| luminance(viridis(f64::from(i) / 100.0))).collect();
        assert!(shades.windows(2).all(|pair| pair[0] < pair[1]));
    }

    /// The contrast of graphics that the Web Content Accessibility Guidelines 2.1 ask for is 3;
    /// pale curves are exempt in no format.
    #[test]
    fn bands_leave_the_first_curves_readable() {
        for index in 0..12 {
            let contrast = (luminance(band(index)) + 0.05) / (luminance(BLUE) + 0.05);
            assert!(contrast > 3.0, "band {index}: {contrast}");
        }
    }
}
