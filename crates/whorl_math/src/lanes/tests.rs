use super::*;

fn some(rows: usize, columns: usize, seed: f64) -> DMatrix<f64> {
    DMatrix::from_fn(rows, columns, |i, k| (seed + (i * 7 + k * 3) as f64).sin())
}

fn sparse_of(matrix: &DMatrix<f64>) -> Sparse {
    let mut sparse = Sparse::default();
    (0..matrix.nrows()).for_each(|i| sparse.push(matrix.row(i).iter().copied()));
    sparse
}

/// Textbook forms, with whole matrices: of what moves only the first coordinates, behind them what stays.
#[test]
fn covariances_grow_and_are_corrected_as_whole_matrices_say() {
    for size in [5, 18, 24, 31, 50] {
        let moving = size - 2;
        let seed = some(size, size, 0.3);
        let mut p = &seed * seed.transpose() + DMatrix::identity(size, size);
        let mut lanes = Lanes::of(&p);
        let off = some(moving, moving, 1.1).map(|x| if x > 0.4 { 0.1 * x } else { 0.0 });
        let mut f = DMatrix::identity(size, size);
        f.view_mut((0, 0), (moving, moving)).copy_from(&(DMatrix::identity(moving, moving) + &off));
        let q = DMatrix::from_diagonal(&nalgebra::DVector::from_fn(size, |i, _| 0.01 * i as f64));
        lanes.grow(&sparse_of(&off), Some(&Lanes::of(&q)));
        p = &f * &p * f.transpose() + &q;
        assert!((lanes.matrix(size, size) - &p).amax() < 1e-12 * p.amax());
        // Readings one after the other are all at once.
        let h = some(3, size, 2.0).map(|x| if x > 0.0 { x } else { 0.0 });
        let r = DMatrix::from_diagonal(&nalgebra::DVector::from_vec(vec![0.5, 1.0, 2.0]));
        let rows = sparse_of(&h);
        let mut gain = Gain::default();
        assert!(lanes.correct(&rows, &[0.5, 1.0, 2.0], &mut gain));
        let s = &h * &p * h.transpose() + r;
        let k = &p * h.transpose() * s.clone().try_inverse().unwrap();
        let expected = (DMatrix::identity(size, size) - &k * &h) * &p;
        assert!((lanes.matrix(size, size) - &expected).amax() < 1e-11 * p.amax());
        let log_det: f64 = gain.variances.iter().map(|s| s.ln()).sum();
        assert!((log_det - s.determinant().ln()).abs() < 1e-11);
        // Sensitivities, with what readings show by themselves.
        let (x, direct) = (some(size, 7, 0.7), some(3, 7, 0.9));
        let mut carried = Lanes::of(&x);
        let mut d = Lanes::of(&direct);
        carried.carry(&sparse_of(&off));
        let moved = &f * &x;
        assert!((carried.matrix(size, 7) - &moved).amax() < 1e-13);
        carried.take_in(&rows, &gain, &mut d);
        let expected = &moved + &k * (&direct - &h * &moved);
        assert!((carried.matrix(size, 7) - expected).amax() < 1e-11);
    }
}

/// Textbook forms: with L = 1 - K H of all readings at once, and their joint variance.
#[test]
fn gradients_go_back_as_whole_matrices_say() {
    for size in [5, 18, 27] {
        let seed = some(size, size, 0.3);
        let p = &seed * seed.transpose() + DMatrix::identity(size, size);
        let h = some(3, size, 2.0).map(|x| if x > 0.0 { x } else { 0.0 });
        let own = [0.5, 1.0, 2.0];
        let rows = sparse_of(&h);
        let mut gain = Gain::default();
        assert!(Lanes::of(&p).correct(&rows, &own, &mut gain));
        let inverse =
            (&h * &p * h.transpose() + DMatrix::from_diagonal(&own.to_vec().into())).try_inverse().unwrap();
        let k = &p * h.transpose() * &inverse;
        let behind = some(size, size, 1.7);
        let (n, g) = (&behind * behind.transpose(), some(size, 1, 0.2));
        let errors = DMatrix::from_column_slice(3, 1, &[0.3, -0.8, 0.5]);
        // Innovations of one after the other.
        let mut said: Vec<Own> = Vec::new();
        for r in 0..3 {
            let before: f64 = gain.couplings(r).iter().zip(&said).map(|(l, e)| l * e.value).sum();
            said.push(Own { value: errors[r] - before, expected: 0.0 });
        }
        let (mut back, mut gradient) = (Lanes::of(&n), g.as_slice().to_vec());
        back.take_out(&rows, &gain, &mut gradient, &mut said);
        let kept = DMatrix::identity(size, size) - &k * &h;
        let expected = kept.transpose() * &n * &kept + h.transpose() * &inverse * &h;
        assert!((back.matrix(size, size) - &expected).amax() < 1e-11 * expected.amax());
        let expected = kept.transpose() * &g + h.transpose() * &inverse * &errors;
        assert!((DMatrix::from_column_slice(size, 1, &gradient) - &expected).amax() < 1e-11);
        let of_errors = &inverse * &errors - k.transpose() * &g;
        let variances = &inverse + k.transpose() * &n * &k;
        for r in 0..3 {
            assert!((said[r].value - of_errors[r]).abs() < 1e-11);
            assert!((said[r].expected - variances[(r, r)]).abs() < 1e-11);
        }
    }
}

#[test]
fn a_covariance_without_a_turn_has_none_left() {
    let seed = some(6, 6, 0.3);
    let p = &seed * seed.transpose();
    let axis = Vector3::new(0.6, 0.0, 0.8);
    let mut lanes = Lanes::of(&p);
    lanes.level_covariance(&axis);
    let mut project = DMatrix::identity(6, 6);
    let turn = nalgebra::Matrix3::identity() - axis * axis.transpose();
    project.view_mut((0, 0), (3, 3)).copy_from(&turn);
    assert!((lanes.matrix(6, 6) - &project * &p * project.transpose()).amax() < 1e-14);
}

/// What swings at W has eigenvalues of size W in whatever units its angle and its rate are, beside slower and faster things.
#[test]
fn the_fastest_rate_knows_no_units() {
    for swings_1_s in [0.05, 9.0, 2.0 * std::f64::consts::PI * 15.0] {
        for unit in [1e-3, 1.0, 50.0] {
            for fades_1_s in [0.2 * swings_1_s, 8.0 * swings_1_s] {
                let mut motion = DMatrix::zeros(4, 4);
                motion[(0, 1)] = unit;
                motion[(1, 0)] = -swings_1_s * swings_1_s / unit;
                motion[(1, 1)] = -0.01 * swings_1_s;
                // An integral, and something that only fades.
                motion[(2, 1)] = 1.0;
                motion[(3, 3)] = -fades_1_s;
                let expected = fades_1_s.max(swings_1_s);
                let found = fastest_rate_1_s(&motion);
                assert!((found / expected - 1.0).abs() < 0.25, "{swings_1_s} {unit} {fades_1_s}: {found}");
            }
        }
    }
    // Nothing but integrals.
    let integrals = DMatrix::from_fn(3, 3, |i, k| if k == i + 1 { 1e4 } else { 0.0 });
    assert_eq!(fastest_rate_1_s(&integrals), 0.0);
}

/// A motion that is lost has no numbers, and is nobody's neighbour: what is beside the columns of a row stays out.
#[test]
fn a_step_of_a_lost_motion_stays_within_its_columns() {
    let motion = DMatrix::from_fn(3, 3, |i, k| if (i, k) == (1, 2) { f64::INFINITY } else { 0.1 });
    let mut step = Step::new(3, 5);
    step.make(&motion, &[1.0; 3], None, &[], 0.1);
    assert_eq!(step.transition.count(), 3);
    assert!(step.transition.entries().all(|(_, column, _)| column < 3));
    let mut covariance = Lanes::of(&DMatrix::identity(5, 5));
    covariance.grow(&step.transition, Some(&step.noise));
}
