//! The Pareto front of points.

/// Indices of the points on the front, the cheapest first. A point is on it if no other point is both cheaper
/// and better, or equal in one and better in the other. Each point is a pair of cost and error.
pub fn front(points: &[(f64, f64)]) -> Vec<usize> {
    let mut order: Vec<usize> =
        (0..points.len()).filter(|i| points[*i].0.is_finite() && points[*i].1.is_finite()).collect();
    order.sort_by(|a, b| points[*a].0.total_cmp(&points[*b].0).then(points[*a].1.total_cmp(&points[*b].1)));
    let mut best = f64::INFINITY;
    order.retain(|i| {
        let better = points[*i].1 < best;
        best = best.min(points[*i].1);
        better
    });
    order
}

#[cfg(test)]
mod tests {
    use super::front;

    #[test]
    fn only_what_is_not_beaten_is_on_the_front() {
        //              on it       beaten by 0  on it       as good as 2, dearer  on it       as dear as 4, worse
        let points = [(1.0, 0.5), (2.0, 0.6), (3.0, 0.2), (4.0, 0.2), (5.0, 0.1), (5.0, 0.15), (0.5, f64::NAN)];
        assert_eq!(front(&points), [0, 2, 4]);
        assert_eq!(front(&[(2.0, 1.0), (1.0, 2.0)]), [1, 0]);
        assert_eq!(front(&[]), [0usize; 0]);
    }
}
