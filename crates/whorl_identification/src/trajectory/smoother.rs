//! Least squares over a chain of states and shared unknowns, eliminated state by state.
//!
//! Each state is joined to the next by its equations of motion, and all of them to the unknowns.
//! Eliminating in order of time keeps the work proportional to the length of the record.

use nalgebra::{Cholesky, Const, DMatrix, DVector, Dyn, OMatrix, SMatrix, SVector};

/// Attitude error, rate, gyro bias, accelerometer bias: three each.
pub(crate) const STATE: usize = 12;
pub(crate) type StateVector = SVector<f64, STATE>;
pub(crate) type StateMatrix = SMatrix<f64, STATE, STATE>;
/// State rows, one column for each unknown.
pub(crate) type CrossMatrix = OMatrix<f64, Const<STATE>, Dyn>;

/// Changes of the unknowns and of every state, and the factor of the unknowns' information.
pub(crate) type Changes = (DVector<f64>, Vec<StateVector>, Cholesky<f64, Dyn>);

/// x' - (transition x + unknowns_column t) = -gap, with the information `weight`.
pub(crate) struct Link {
    pub transition: StateMatrix,
    pub unknowns: CrossMatrix,
    /// The state after, less the state carried to it.
    pub gap: StateVector,
    pub weight: StateMatrix,
}

/// Information about the current state and the unknowns, all earlier states eliminated.
pub(crate) struct Elimination {
    state: StateMatrix,
    cross: CrossMatrix,
    state_right: StateVector,
    pub unknowns: DMatrix<f64>,
    pub unknowns_right: DVector<f64>,
    eliminated: Vec<Eliminated>,
    /// Logarithm of the determinant of everything eliminated.
    pub log_determinant: f64,
}

struct Eliminated {
    constant: StateVector,
    by_unknowns: CrossMatrix,
    /// `None` at the end of a chain.
    by_next: Option<StateMatrix>,
}

impl Elimination {
    pub fn new(unknowns: usize) -> Self {
        Self {
            state: StateMatrix::zeros(),
            cross: CrossMatrix::zeros(unknowns),
            state_right: StateVector::zeros(),
            unknowns: DMatrix::zeros(unknowns, unknowns),
            unknowns_right: DVector::zeros(unknowns),
            eliminated: Vec::new(),
            log_determinant: 0.0,
        }
    }

    /// Adds prior information about the current state: information times (value - linearisation point).
    pub fn add_state(&mut self, information: &StateMatrix, right: &StateVector) {
        self.state += information;
        self.state_right += right;
    }

    /// Adds measurements: normal equations over the state (first) and the unknowns.
    pub fn add_measurements(&mut self, normal: &DMatrix<f64>, right: &DVector<f64>) {
        let m = self.unknowns.nrows();
        self.state += normal.fixed_view::<STATE, STATE>(0, 0);
        self.cross += normal.view((0, STATE), (STATE, m));
        self.unknowns += normal.view((STATE, STATE), (m, m));
        self.state_right += right.fixed_rows::<STATE>(0);
        self.unknowns_right += right.rows(STATE, m);
    }

    /// Eliminates the current state and goes on to the next; `None`: the last one.
    /// `Err` when the state is not determined by anything.
    pub fn advance(&mut self, link: Option<&Link>) -> Result<(), &'static str> {
        let m = self.unknowns.nrows();
        let mut next = None;
        if let Some(link) = link {
            let weighted = link.transition.transpose() * link.weight;
            let by_unknowns = link.weight * &link.unknowns;
            self.state += weighted * link.transition;
            self.cross += weighted * &link.unknowns;
            self.unknowns += link.unknowns.transpose() * &by_unknowns;
            self.state_right += weighted * link.gap;
            self.unknowns_right += by_unknowns.transpose() * link.gap;
            next = Some((-weighted, link.weight, -by_unknowns, -(link.weight * link.gap)));
        }
        let factor = self.state.cholesky().ok_or("a state is not determined by the measurements")?;
        self.log_determinant += 2.0 * factor.l().diagonal().map(f64::ln).sum();
        let constant = factor.solve(&self.state_right);
        let mut by_unknowns = self.cross.clone();
        factor.solve_mut(&mut by_unknowns);
        self.unknowns -= self.cross.transpose() * &by_unknowns;
        self.unknowns_right -= self.cross.transpose() * constant;
        let by_next = next.map(|(to_next, weight, next_cross, next_right)| {
            let by_next = factor.solve(&to_next);
            self.state_right = next_right - to_next.transpose() * constant;
            let cross = next_cross - to_next.transpose() * &by_unknowns;
            self.state = weight - to_next.transpose() * by_next;
            self.state = 0.5 * (self.state + self.state.transpose());
            self.cross = cross;
            by_next
        });
        if by_next.is_none() {
            self.state = StateMatrix::zeros();
            self.cross = CrossMatrix::zeros(m);
            self.state_right = StateVector::zeros();
        }
        self.eliminated.push(Eliminated { constant, by_unknowns, by_next });
        Ok(())
    }

    /// Solves for the unknowns and then, backwards, for every state. Returns the changes and the factor
    /// of the unknowns' information.
    pub fn solve(&self) -> Result<Changes, &'static str> {
        let symmetric = 0.5 * (&self.unknowns + self.unknowns.transpose());
        let factor = symmetric.cholesky().ok_or("the unknowns are not determined")?;
        let unknowns = factor.solve(&self.unknowns_right);
        let states = self.states(&unknowns);
        Ok((unknowns, states, factor))
    }

    /// Changes of every state for a change of the unknowns.
    pub fn states(&self, unknowns: &DVector<f64>) -> Vec<StateVector> {
        let mut states = vec![StateVector::zeros(); self.eliminated.len()];
        let mut after = StateVector::zeros();
        for (slot, e) in states.iter_mut().zip(&self.eliminated).rev() {
            let mut x = e.constant - &e.by_unknowns * unknowns;
            if let Some(by_next) = &e.by_next {
                x -= by_next * after;
            }
            *slot = x;
            after = x;
        }
        states
    }
}
