//! Normal equations.

use crate::fitting::normal_equations::*;

#[test]
fn evidence_is_the_density_of_the_data() {
    // One column of ones over two rows, y = (1, 2), prior variance 4: y ~ N(0, I + 4 11^T).
    let mut normal = Normal::zeros(1);
    normal.matrix[(0, 0)] = 2.0;
    normal.vector[0] = 3.0;
    let estimate = Estimate::new(&normal, &[0], |_| 4.0).unwrap();
    // det = 9, y^T C^-1 y = 5 - 4/9 * 9 = 1; noise alone: 5.
    let expected = -0.5 * 9f64.ln() - 0.5 + 2.5;
    assert!((estimate.log_evidence - expected).abs() < 1e-12);
}
