//! Frames a second, as the fractions that films and television have.

/// The rates of television that are no whole numbers.
const BROADCAST: [[u32; 2]; 4] = [[24000, 1001], [30000, 1001], [60000, 1001], [120_000, 1001]];

/// The highest rate that frames of a rate that varies are brought to.
const MOST: u32 = 120;

/// Containers round time stamps to a millisecond.
const ROUNDING: f64 = 0.0011;

fn fps([rate, of]: [u32; 2]) -> f64 {
    f64::from(rate) / f64::from(of)
}

/// A rate as a fraction, with the denominators that television has.
pub fn rational(rate: f64) -> [u32; 2] {
    if let Some(known) = BROADCAST.into_iter().find(|known| (rate - fps(*known)).abs() < 0.002) {
        return known;
    }
    if (rate - rate.round()).abs() < 1e-6 && rate >= 1.0 {
        return [rate.round() as u32, 1];
    }
    [(rate * 1000.0).round().max(1.0) as u32, 1000]
}

/// The lowest usual rate of which all these times are multiples, in seconds, but for a time stamp's rounding.
pub fn common(times: &[f64]) -> Option<[u32; 2]> {
    let (first, least) = (*times.first()?, shortest(times)?);
    let error = |rate: &[u32; 2]| {
        let off = |time: &f64| {
            let at = (time - first) * fps(*rate);
            (at - at.round()).abs() / fps(*rate)
        };
        times.iter().map(off).fold(0.0, f64::max)
    };
    // Frames must not fall on one another.
    let apart = |rate: &[u32; 2]| (least + ROUNDING) * fps(*rate) >= 1.0;
    let mut rates: Vec<[u32; 2]> = (1..=MOST).map(|rate| [rate, 1]).chain(BROADCAST).collect();
    rates.retain(|rate| apart(rate) && error(rate) <= ROUNDING);
    let lowest = rates.iter().copied().map(fps).min_by(f64::total_cmp)?;
    // 30 and 30000/1001 may both do.
    rates.into_iter().filter(|rate| fps(*rate) < 1.01 * lowest).min_by(|a, b| error(a).total_cmp(&error(b)))
}

/// The whole number of frames a second that is nearest to the rate of the shortest frame.
pub fn of_shortest(times: &[f64]) -> Option<[u32; 2]> {
    let rate = (1.0 / shortest(times)?).min(f64::from(MOST));
    Some([(rate.round() as u32).max(1), 1])
}

fn shortest(times: &[f64]) -> Option<f64> {
    times.windows(2).map(|pair| pair[1] - pair[0]).filter(|step| *step > 0.0).min_by(f64::total_cmp)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn rounded_time_stamps_give_the_rate_of_the_camera() {
        let stamps = |rate: f64, kept: &dyn Fn(u32) -> bool| -> Vec<f64> {
            (0..400).filter(|i| kept(*i)).map(|i| (1000.0 * f64::from(i) / rate).round() / 1000.0).collect()
        };
        let some = |i: u32| i % 7 != 3 && i % 11 != 5;
        for rate in [[24000, 1001], [24, 1], [25, 1], [30000, 1001], [30, 1], [50, 1], [60000, 1001], [60, 1]] {
            assert_eq!(common(&stamps(fps(rate), &some)), Some(rate));
        }
        assert_eq!(common(&stamps(30.0, &|i| i < 12 && some(i))), Some([30, 1]));
        assert_eq!(common(&[0.0, 0.1, 0.5, 0.9]), Some([10, 1]));
        // A phone's clock
        let uneven: Vec<f64> = (0..90).map(|i| f64::from(i) * 0.0333 + 0.0041 * f64::from(i * 7 % 5)).collect();
        assert_eq!((common(&uneven), of_shortest(&uneven)), (None, Some([48, 1])));
        assert_eq!((common(&[]), common(&[3.0]), of_shortest(&[3.0])), (None, None, None));
    }

    #[test]
    fn rates_are_fractions() {
        assert_eq!([23.976, 12.5, 25.0].map(rational), [[24000, 1001], [12500, 1000], [25, 1]]);
    }
}
