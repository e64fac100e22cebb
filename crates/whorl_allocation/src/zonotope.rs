//! The exact oracle: the attainable torques, and their least cost.
//!
//! Effectors with bounds, x_k = lower_k + width_k v_k, 0 <= v_k <= 1, attain the set
//! Z = o + { sum a_k v_k }: a zonotope (Durham, "Constrained Control Allocation", J. Guidance 16(4),
//! 1993, calls it the attainable moment subset; Ziegler, *Lectures on Polytopes*, ch. 7). Every
//! facet is spanned by two generators, so its normal is n = a_i x a_j and
//!
//! tau in Z  <=>  n'tau <= h(n) = n'o + sum max(0, n'a_k)  for every such n, both signs.
//!
//! The largest share alpha of a torque is then the smallest of the ratios h(n) / n'tau. Sets that are
//! flat (all generators in a plane) or thin (on a line) get the normals of that plane or line as well.
//!
//! Least cost of a torque inside Z is a linear program; its dual,
//!
//! max over y of  y'(tau - o) + sum min(0, c_k - a_k'y),
//!
//! is concave and piecewise linear in three unknowns, so the maximum is at a vertex: the solution
//! of a_k'y = c_k for three generators. Any y gives a lower bound, so rounding cannot flatter.
//!
//! Nothing here iterates or uses the quadratic program's solver.

use nalgebra::Vector3;

use crate::allocation::Allocation;
use crate::demand::{JetMask, TorqueDemand, TorqueDemandError};
use crate::effectors::Effectors;
use crate::problem::Problem;

/// Sine below which generators count as parallel or coplanar.
const FLAT: f64 = 1e-10;

/// An attainable torque set: the image of a box under its generators.
#[derive(Debug, Clone, PartialEq)]
pub struct Zonotope {
    /// Unit normal n and support h(n); each pair of opposite facets appears as two entries.
    facets: Vec<(Vector3<f64>, f64)>,
    /// Size of the set, for tolerances.
    size: f64,
}

impl Zonotope {
    /// The set offset + sum `generators[k]` v_k, 0 <= v_k <= 1. Zero, parallel and coplanar
    /// generators are welcome; entries must be finite.
    #[must_use]
    pub fn new(generators: &[Vector3<f64>], offset: Vector3<f64>) -> Self {
        let mut zonotope = Self { facets: Vec::new(), size: offset.norm() };
        zonotope.size += generators.iter().map(|a| a.norm()).sum::<f64>();
        let mut add = |normal: Vector3<f64>| {
            let (mut forward, mut backward) = (0.0, 0.0);
            for a in generators {
                let height = normal.dot(a);
                forward += height.max(0.0);
                backward += (-height).max(0.0);
            }
            let base = normal.dot(&offset);
            zonotope.facets.push((normal, forward + base));
            zonotope.facets.push((-normal, backward - base));
        };
        match Span::of(generators) {
            Span::Space => {
                for (i, a) in generators.iter().enumerate() {
                    for b in &generators[i + 1..] {
                        let normal = a.cross(b);
                        let norm = normal.norm();
                        if norm > FLAT * a.norm() * b.norm() {
                            add(normal / norm);
                        }
                    }
                }
            }
            Span::Plane(plane) => {
                add(plane);
                for a in generators {
                    if let Some(normal) = plane.cross(a).try_normalize(0.0) {
                        add(normal);
                    }
                }
            }
            Span::Line(line) => {
                let (across, up) = perpendicular(line);
                add(line);
                add(across);
                add(up);
            }
            Span::Point => {
                add(Vector3::x());
                add(Vector3::y());
                add(Vector3::z());
            }
        }
        zonotope
    }

    /// Least and largest alpha in 0..=1 with alpha * `torque` attainable; `None` when there is none.
    #[must_use]
    pub fn alpha_range(&self, torque: &Vector3<f64>) -> Option<(f64, f64)> {
        self.reach(torque).map(|reach| (reach.least, reach.most))
    }

    /// [`Self::alpha_range`] with the facet that limits it.
    pub(crate) fn reach(&self, torque: &Vector3<f64>) -> Option<Reach> {
        let mut reach = Reach { least: 0.0, most: 1.0, facet_normal: None };
        let room = 1e-14 * self.size;
        let parallel = 1e-13 * torque.norm();
        for (normal, support) in &self.facets {
            let height = normal.dot(torque);
            if height > parallel {
                let ratio = (support + room) / height;
                if ratio < reach.most {
                    reach.most = ratio;
                    reach.facet_normal = Some(*normal);
                }
            } else if height < -parallel {
                reach.least = reach.least.max((support + room) / height);
            } else if *support < -room {
                return None;
            }
        }
        (reach.least <= reach.most).then_some(reach)
    }

    /// Largest alpha in 0..=1 with alpha * `torque` attainable; `None` when there is none.
    #[must_use]
    pub fn alpha_max(&self, torque: &Vector3<f64>) -> Option<f64> {
        self.alpha_range(torque).map(|(_, most)| most)
    }
}

/// How far a torque can be followed inside the set.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Reach {
    pub least: f64,
    pub most: f64,
    /// Outward normal of the facet at `most`; `None` when the whole torque is attainable.
    pub facet_normal: Option<Vector3<f64>>,
}

/// Least cost of attaining a torque, as a table of affine functions of the torque.
#[derive(Debug, Clone, PartialEq)]
pub struct LeastCost {
    /// Price y and constant: cost >= y'tau + constant, with equality for one of them.
    pieces: Vec<(Vector3<f64>, f64)>,
}

impl LeastCost {
    /// The table for the set of [`Zonotope::new`], with `cost[k]` per unit of v_k.
    #[must_use]
    pub fn new(generators: &[Vector3<f64>], offset: Vector3<f64>, cost: &[f64]) -> Self {
        let mut table = Self { pieces: Vec::new() };
        let mut add = |price: Vector3<f64>| {
            let slack = |(a, c): (&Vector3<f64>, &f64)| (c - a.dot(&price)).min(0.0);
            let constant = generators.iter().zip(cost).map(slack).sum::<f64>();
            table.pieces.push((price, constant - price.dot(&offset)));
        };
        let pairs: Vec<_> = generators.iter().zip(cost).collect();
        match Span::of(generators) {
            Span::Space => {
                for (i, (a, ca)) in pairs.iter().enumerate() {
                    for (j, (b, cb)) in pairs.iter().enumerate().skip(i + 1) {
                        let (ab, size) = (a.cross(b), a.norm() * b.norm());
                        if ab.norm() <= FLAT * size {
                            continue;
                        }
                        for (c, cc) in &pairs[j + 1..] {
                            let volume = ab.dot(c);
                            if volume.abs() > FLAT * size * c.norm() {
                                let sum = b.cross(c) * **ca + c.cross(a) * **cb + ab * **cc;
                                add(sum / volume);
                            }
                        }
                    }
                }
            }
            Span::Plane(plane) => {
                for (i, (a, ca)) in pairs.iter().enumerate() {
                    for (b, cb) in &pairs[i + 1..] {
                        let area = plane.dot(&a.cross(b));
                        if area.abs() > FLAT * a.norm() * b.norm() {
                            add((b.cross(&plane) * **ca + plane.cross(a) * **cb) / area);
                        }
                    }
                }
            }
            Span::Line(_) => {
                for (a, c) in &pairs {
                    if a.norm_squared() > 0.0 {
                        add(**a * (**c / a.norm_squared()));
                    }
                }
            }
            Span::Point => add(Vector3::zeros()),
        }
        table
    }

    /// Least cost of `torque`, which must be attainable: outside the set the number has no meaning.
    #[must_use]
    pub fn of(&self, torque: &Vector3<f64>) -> f64 {
        self.pieces
            .iter()
            .map(|(price, constant)| price.dot(torque) + constant)
            .fold(f64::NEG_INFINITY, f64::max)
    }
}

/// What the generators span.
enum Span {
    Space,
    /// With its unit normal.
    Plane(Vector3<f64>),
    /// With its unit direction.
    Line(Vector3<f64>),
    Point,
}

impl Span {
    fn of(generators: &[Vector3<f64>]) -> Self {
        // Directions from the longest generators: short ones are all rounding.
        let longest = generators.iter().map(|a| a.norm()).fold(0.0, f64::max);
        let Some(first) = generators.iter().find(|a| a.norm() == longest).and_then(|a| a.try_normalize(0.0))
        else {
            return Self::Point;
        };
        let mut widest = Vector3::zeros();
        for a in generators {
            let across = first.cross(a);
            if across.norm() > widest.norm() {
                widest = across;
            }
        }
        if widest.norm() <= FLAT * longest {
            return Self::Line(first);
        }
        let Some(normal) = widest.try_normalize(0.0) else {
            return Self::Line(first);
        };
        if generators.iter().all(|a| normal.dot(a).abs() <= FLAT * longest) {
            Self::Plane(normal)
        } else {
            Self::Space
        }
    }
}

/// Two unit vectors that complete `direction` to a right-handed triad.
fn perpendicular(direction: Vector3<f64>) -> (Vector3<f64>, Vector3<f64>) {
    let axis = if direction.x.abs() < 0.6 { Vector3::x() } else { Vector3::y() };
    let across = direction.cross(&axis).try_normalize(0.0).unwrap_or_else(Vector3::z);
    (across, direction.cross(&across))
}

/// An allocation beside the exact answer.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct CrossCheck {
    /// Largest attainable share of the demand; `None` when the bounds exclude every share.
    pub alpha_max: Option<f64>,
    /// |achieved - alpha tau|, in units of full torque (the strongest free effector's). For a
    /// fallback, which does not promise a share of the demand, this is no error.
    pub torque_error: f64,
    /// Largest violation of a bound, jets as fractions and motors in units of their limit.
    pub bound_violation: f64,
    /// Least gas rate for the torque that the jets were given, with the motors as allocated [kg/s].
    pub least_gas_rate_kg_s: f64,
    /// Allocated gas rate [kg/s].
    pub gas_rate_kg_s: f64,
    /// Gas rate of one jet fully open, for tolerances [kg/s]: the largest.
    pub jet_gas_rate_kg_s: f64,
    /// Reported alpha.
    pub alpha: f64,
}

impl CrossCheck {
    /// Compares. All numbers of the allocation are recomputed from its effector values.
    ///
    /// # Errors
    /// [`TorqueDemandError`] when the demand is not well formed.
    pub fn new(
        effectors: &Effectors,
        demand: &TorqueDemand,
        allocation: &Allocation,
    ) -> Result<Self, TorqueDemandError> {
        demand.check(effectors)?;
        let mut problem = Problem::default();
        problem.fill(effectors, demand);
        let jets = effectors.jets();
        let layout = effectors.layout();

        let torque = effectors.torque_b_n_m(&allocation.jet_on_fraction, &allocation.motor_command);
        let values = allocation.jet_on_fraction.iter().chain(&allocation.motor_command);
        let mut bound_violation = 0.0_f64;
        for (k, &value) in values.enumerate().take(problem.len()) {
            let unit = if k < jets { 1.0 } else { layout.motor_limit[k - jets] };
            let below = problem.lower[k] - value;
            let above = value - problem.lower[k] - problem.width[k];
            bound_violation = bound_violation.max(below / unit).max(above / unit);
        }

        let jet_torque = effectors.torque_b_n_m(&allocation.jet_on_fraction, &[]);
        let (mut generators, mut cost, mut offset, mut held) = (vec![], vec![], Vector3::zeros(), 0.0);
        for (j, rate) in layout.jet_gas_rate_kg_s.iter().enumerate() {
            generators.push(problem.columns[j] * problem.scale_n_m);
            cost.push(rate * problem.width[j]);
            offset += effectors.column(j) * problem.lower[j];
            held += rate * problem.lower[j];
        }
        let rates = &layout.jet_gas_rate_kg_s;
        let least = LeastCost::new(&generators, offset, &cost).of(&jet_torque).max(0.0) + held;
        Ok(Self {
            alpha_max: Zonotope::new(&problem.columns, problem.offset).alpha_max(&problem.torque),
            torque_error: (torque - demand.torque_b_n_m * allocation.alpha).norm() / problem.scale_n_m,
            bound_violation,
            least_gas_rate_kg_s: least,
            gas_rate_kg_s: allocation.jet_on_fraction.iter().zip(rates).map(|(u, r)| u * r).sum(),
            jet_gas_rate_kg_s: rates.iter().copied().fold(0.0, f64::max),
            alpha: allocation.alpha,
        })
    }

    /// True when share, torque, bounds and gas agree with the oracle: alpha and torque within
    /// 1e-6, gas within 0.1 %. Not meaningful for a fallback, nor (the gas) when net force is priced.
    #[must_use]
    pub fn agrees(&self) -> bool {
        let Some(alpha_max) = self.alpha_max else {
            return false;
        };
        (self.alpha - alpha_max).abs() <= 1e-6
            && self.torque_error <= 1e-6
            && self.bound_violation <= 1e-12
            && self.gas_rate_kg_s <= 1.001 * self.least_gas_rate_kg_s + 1e-9 * self.jet_gas_rate_kg_s
    }
}

/// The jets whose torque a mask leaves, as generators [N m]: for tables made ahead of time.
#[must_use]
pub fn jet_generators(effectors: &Effectors, available: JetMask) -> Vec<Vector3<f64>> {
    (0..effectors.jets())
        .map(|j| if available.contains(j) { effectors.column(j) } else { Vector3::zeros() })
        .collect()
}
