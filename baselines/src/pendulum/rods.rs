//! The reduced chain in lanes: several rods side by side, each with numbers of its own.
//!
//! These are the equations of [`Chain`](super::Chain) for [`ORDER`] coordinates, divided by the mass of a node,
//! and their exact derivatives. A bank of filters believes in many rods at once: here they share each
//! instruction. Nothing takes memory, and no operation depends on the instruction set.

use super::{Chain, RodDesign};
use rodgym_core::lane::{Mask, Real};

/// Coordinates of the model: order 12 at most, whatever the plant.
pub const ORDER: usize = 6;
/// Numbers of a state: coordinates, then rates.
pub const STATE: usize = 2 * ORDER;

/// A vector of coordinates.
pub type Coordinates<R> = [R; ORDER];
/// A state: coordinates, then rates.
pub type State<R> = [R; STATE];

/// Rods side by side, with the same number of nodes.
#[derive(Clone, Debug)]
pub struct Rods<R> {
    /// Rows of S, one an edge. A rod of fewer edges than `ORDER` leaves the last coordinates alone.
    shape: Vec<Coordinates<f64>>,
    coordinates: usize,
    /// Length of an edge \[m\].
    edge: R,
    gravity: R,
    /// Bending stiffness E I / l over a node's mass \[m^2/s^2\].
    stiffness: R,
    /// Kelvin-Voigt time \[s\].
    beta: R,
    /// Nodal drag over a node's mass \[1/s\].
    drag: R,
    /// One over a node's mass \[1/kg\].
    mobility: R,
}

/// How a rod differs from its design: factors of its stiffness and of its mobility.
#[derive(Clone, Copy, Debug)]
pub struct Feel<R> {
    /// Factor of the stiffness.
    pub stiffness: R,
    /// Factor of the mobility (of one over the mass, for the torque).
    pub mobility: R,
}

impl<R: Real> Feel<R> {
    /// As designed.
    #[inline(always)]
    pub fn one() -> Self {
        Feel { stiffness: R::one(), mobility: R::one() }
    }
}

/// What a state's accelerations depend on: d(accelerations) = `angle` dq + `rate` d(rates) + ...
#[derive(Clone, Copy, Debug)]
pub struct Slope<R> {
    /// By the coordinates.
    pub angle: [Coordinates<R>; ORDER],
    /// By the rates.
    pub rate: [Coordinates<R>; ORDER],
    /// By the logarithm of the stiffness.
    pub stiffness: Coordinates<R>,
    /// By the logarithm of the mobility: the torque's part.
    pub mobility: Coordinates<R>,
}

impl<R: Real> Rods<R> {
    /// The rods of a row of designs, one a lane; lanes beyond their number repeat the last.
    ///
    /// # Panics
    /// No rods, or rods whose numbers of nodes differ.
    pub fn new(rods: &[RodDesign]) -> Self {
        assert!(rods.iter().all(|rod| rod.nodes == rods[0].nodes), "rods of one shape");
        let chain = Chain::new(&rods[0], ORDER);
        let matrix = chain.shape();
        let coordinates = chain.coordinates();
        let row =
            |i: usize| std::array::from_fn(|j| if j < coordinates { matrix[(i, j)] } else { 0.0 });
        let lane = |number: fn(&RodDesign) -> f64| {
            R::from_fn(|lane| number(&rods[lane.min(rods.len() - 1)]))
        };
        Rods {
            shape: (0..chain.edges()).map(row).collect(),
            coordinates,
            edge: lane(RodDesign::edge_length),
            gravity: lane(|rod| rod.gravity),
            stiffness: lane(|rod| rod.bending_stiffness() / rod.edge_length() / rod.node_mass()),
            beta: lane(|rod| rod.bending_damping),
            drag: lane(|rod| rod.damping / rod.node_mass()),
            mobility: lane(|rod| 1.0 / rod.node_mass()),
        }
    }

    /// A lane's state as [`Chain`] has it: coordinates in use, then their rates. Returns how many.
    #[inline(always)]
    pub fn lane(&self, x: &State<R>, lane: usize, out: &mut State<f64>) -> usize {
        let k = self.coordinates;
        for i in 0..k {
            out[i] = x[i].get(lane);
            out[k + i] = x[ORDER + i].get(lane);
        }
        2 * k
    }

    /// Row of S of the base edge: base angle = row . q.
    #[inline(always)]
    pub fn base(&self) -> &Coordinates<f64> {
        &self.shape[0]
    }

    /// Coordinates of straight rods at an angle (or rates, from a rate).
    #[inline(always)]
    pub fn straight(&self, angle: R) -> Coordinates<R> {
        let mut q = [R::zero(); ORDER];
        for row in &self.shape {
            for j in 0..ORDER {
                q[j] += R::splat(row[j]) * angle;
            }
        }
        q
    }

    /// Accelerations of the coordinates under a base torque \[N m\].
    #[inline(always)]
    pub fn acceleration(&self, x: &State<R>, torque: R, feel: &Feel<R>) -> Coordinates<R> {
        let zero = R::zero();
        let l = self.edge;
        let stiffness = self.stiffness * feel.stiffness;
        let last = self.shape.len() - 1;
        let mut inertia = [[zero; ORDER]; ORDER];
        let mut force = [zero; ORDER];
        let (mut jx, mut jy) = ([zero; ORDER], [zero; ORDER]);
        let (mut vx, mut vy, mut ax, mut ay) = (zero, zero, zero, zero);
        let mut before = (zero, zero, zero);
        for (i, row) in self.shape.iter().enumerate() {
            let (angle, rate) = at(row, x);
            let (sin, cos) = sin_cos(angle);
            let (lc, ls) = (l * cos, l * sin);
            for j in 0..ORDER {
                jx[j] += lc * R::splat(row[j]);
                jy[j] += ls * R::splat(row[j]);
            }
            vx += lc * rate;
            vy += ls * rate;
            ax += -(ls * rate * rate);
            ay += lc * rate * rate;
            let mass = R::splat(if i == last { 0.5 } else { 1.0 });
            let fx = -(mass * ax) - self.drag * vx;
            let fy = -(mass * (ay + self.gravity)) - self.drag * vy;
            for a in 0..ORDER {
                force[a] += jx[a] * fx + jy[a] * fy;
                let (mx, my) = (mass * jx[a], mass * jy[a]);
                for b in 0..=a {
                    inertia[a][b] += mx * jx[b] + my * jy[b];
                }
            }
            if i > 0 {
                let curvature = curvature(before, (sin, cos));
                let moment = stiffness
                    * (curvature * (R::one() + R::splat(0.25) * curvature * curvature)
                        + self.beta * (rate - before.2));
                for j in 0..ORDER {
                    force[j] += -(moment * R::splat(row[j] - self.shape[i - 1][j]));
                }
            }
            before = (sin, cos, rate);
        }
        let push = torque * self.mobility * feel.mobility;
        for j in 0..ORDER {
            force[j] += R::splat(self.shape[0][j]) * push;
        }
        self.factor(&mut inertia);
        solve(&inertia, &mut force);
        force
    }

    /// How the accelerations depend on state, stiffness and mobility: with a the accelerations of M a = f,
    /// M da = df - dM a.
    #[inline(always)]
    pub fn slope(&self, x: &State<R>, torque: R, feel: &Feel<R>) -> Slope<R> {
        let zero = R::zero();
        let a = self.acceleration(x, torque, feel);
        let l = self.edge;
        let stiffness = self.stiffness * feel.stiffness;
        let last = self.shape.len() - 1;
        let mut inertia = [[zero; ORDER]; ORDER];
        let (mut by_angle, mut by_rate) = ([[zero; ORDER]; ORDER], [[zero; ORDER]; ORDER]);
        let mut bending = [zero; ORDER];
        // Of the current node: position's derivative J and its derivative, force at the accelerations a
        // and the force's derivatives.
        let (mut jx, mut jy) = ([zero; ORDER], [zero; ORDER]);
        let (mut hx, mut hy) = ([[zero; ORDER]; ORDER], [[zero; ORDER]; ORDER]);
        let (mut vx, mut vy, mut ax, mut ay) = (zero, zero, zero, zero);
        let mut vq = [[zero; ORDER]; 2];
        let mut aq = [[zero; ORDER]; 2];
        let mut aw = [[zero; ORDER]; 2];
        let mut before = (zero, zero, zero);
        for (i, row) in self.shape.iter().enumerate() {
            let (angle, rate) = at(row, x);
            let mut acceleration = zero;
            for j in 0..ORDER {
                acceleration += R::splat(row[j]) * a[j];
            }
            let (sin, cos) = sin_cos(angle);
            let (lc, ls) = (l * cos, l * sin);
            let square = rate * rate;
            vx += lc * rate;
            vy += ls * rate;
            ax += lc * acceleration - ls * square;
            ay += ls * acceleration + lc * square;
            let turned = [-(ls * acceleration) - lc * square, lc * acceleration - ls * square];
            let twice = rate + rate;
            for j in 0..ORDER {
                let s = R::splat(row[j]);
                jx[j] += lc * s;
                jy[j] += ls * s;
                vq[0][j] += -(ls * rate * s);
                vq[1][j] += lc * rate * s;
                aq[0][j] += turned[0] * s;
                aq[1][j] += turned[1] * s;
                aw[0][j] += -(ls * twice * s);
                aw[1][j] += lc * twice * s;
                for k in 0..=j {
                    let s = s * R::splat(row[k]);
                    hx[j][k] += -(ls * s);
                    hy[j][k] += lc * s;
                }
            }
            let mass = R::splat(if i == last { 0.5 } else { 1.0 });
            let fx = -(mass * ax) - self.drag * vx;
            let fy = -(mass * (ay + self.gravity)) - self.drag * vy;
            for j in 0..ORDER {
                for k in 0..=j {
                    inertia[j][k] += mass * (jx[j] * jx[k] + jy[j] * jy[k]);
                    let turning = fx * hx[j][k] + fy * hy[j][k];
                    by_angle[j][k] += turning;
                    if k < j {
                        by_angle[k][j] += turning;
                    }
                }
            }
            for k in 0..ORDER {
                let fqx = -(mass * aq[0][k]) - self.drag * vq[0][k];
                let fqy = -(mass * aq[1][k]) - self.drag * vq[1][k];
                let fwx = -(mass * aw[0][k]) - self.drag * jx[k];
                let fwy = -(mass * aw[1][k]) - self.drag * jy[k];
                for j in 0..ORDER {
                    by_angle[j][k] += jx[j] * fqx + jy[j] * fqy;
                    by_rate[j][k] += jx[j] * fwx + jy[j] * fwy;
                }
            }
            if i > 0 {
                let curvature = curvature(before, (sin, cos));
                let quarter = R::splat(0.25) * curvature * curvature;
                let bent = curvature * (R::one() + quarter);
                let moment = stiffness * (bent + self.beta * (rate - before.2));
                let stiff = stiffness * (R::one() + quarter) * (R::one() + R::splat(3.0) * quarter);
                let slow = stiffness * self.beta;
                for j in 0..ORDER {
                    let dj = R::splat(row[j] - self.shape[i - 1][j]);
                    bending[j] += -(moment * dj);
                    for k in 0..ORDER {
                        let d = dj * R::splat(row[k] - self.shape[i - 1][k]);
                        by_angle[j][k] += -(stiff * d);
                        by_rate[j][k] += -(slow * d);
                    }
                }
            }
            before = (sin, cos, rate);
        }
        self.factor(&mut inertia);
        let push = torque * self.mobility * feel.mobility;
        let mut pushed = [zero; ORDER];
        for j in 0..ORDER {
            pushed[j] = R::splat(self.shape[0][j]) * push;
        }
        solve(&inertia, &mut bending);
        solve(&inertia, &mut pushed);
        for matrix in [&mut by_angle, &mut by_rate] {
            for k in 0..ORDER {
                let mut column = [zero; ORDER];
                for j in 0..ORDER {
                    column[j] = matrix[j][k];
                }
                solve(&inertia, &mut column);
                for j in 0..ORDER {
                    matrix[j][k] = column[j];
                }
            }
        }
        Slope { angle: by_angle, rate: by_rate, stiffness: bending, mobility: pushed }
    }

    /// One step of the classical Runge-Kutta method under a held torque.
    #[inline(always)]
    pub fn step(&self, x: &mut State<R>, torque: R, feel: &Feel<R>, dt: f64) {
        let start = *x;
        let mut at = start;
        for (weight, ahead) in [(1.0, 0.5), (2.0, 0.5), (2.0, 1.0), (1.0, 0.0)] {
            let a = self.acceleration(&at, torque, feel);
            let (weight, ahead) = (R::splat(dt / 6.0 * weight), R::splat(dt * ahead));
            for i in 0..ORDER {
                let rate = at[ORDER + i];
                x[i] += weight * rate;
                at[i] = start[i] + ahead * rate;
                x[ORDER + i] += weight * a[i];
                at[ORDER + i] = start[ORDER + i] + ahead * a[i];
            }
        }
    }

    /// Cholesky's decomposition of the inertia, in place; coordinates that are not used get an inertia of 1.
    #[inline(always)]
    fn factor(&self, m: &mut [Coordinates<R>; ORDER]) {
        for i in self.coordinates..ORDER {
            m[i][i] = R::one();
        }
        for i in 0..ORDER {
            for j in 0..i {
                let mut sum = m[i][j];
                for c in 0..j {
                    sum += -(m[i][c] * m[j][c]);
                }
                m[i][j] = sum * m[j][j];
            }
            let mut sum = m[i][i];
            for c in 0..i {
                sum += -(m[i][c] * m[i][c]);
            }
            // The diagonal holds inverses.
            m[i][i] = R::one() / sum.sqrt();
        }
    }
}

/// Solves with a decomposition that `factor` made.
#[inline(always)]
fn solve<R: Real>(m: &[Coordinates<R>; ORDER], f: &mut Coordinates<R>) {
    for i in 0..ORDER {
        for c in 0..i {
            f[i] -= m[i][c] * f[c];
        }
        f[i] *= m[i][i];
    }
    for i in (0..ORDER).rev() {
        for c in i + 1..ORDER {
            f[i] -= m[c][i] * f[c];
        }
        f[i] *= m[i][i];
    }
}

/// Angle and rate of an edge.
#[inline(always)]
fn at<R: Real>(row: &Coordinates<f64>, x: &State<R>) -> (R, R) {
    let (mut angle, mut rate) = (R::zero(), R::zero());
    for j in 0..ORDER {
        angle += R::splat(row[j]) * x[j];
        rate += R::splat(row[j]) * x[ORDER + j];
    }
    (angle, rate)
}

/// Curvature 2 tan(turn / 2) between an edge and the next, from their sines and cosines.
#[inline(always)]
fn curvature<R: Real>(before: (R, R, R), (sin, cos): (R, R)) -> R {
    let cross = before.1 * sin - before.0 * cos;
    (cross + cross) / (R::one() + before.1 * cos + before.0 * sin)
}

/// The nearest whole number (of at most 2^51).
#[inline(always)]
pub fn round<R: Real>(x: R) -> R {
    // Beyond 2^52 a double has no fraction: adding and subtracting such a number rounds.
    let big = R::splat(6_755_399_441_055_744.0);
    (x + big) - big
}

/// Sine and cosine in all lanes at once, to 1e-13 for |x| < 100: far below what the model lacks.
#[inline(always)]
pub fn sin_cos<R: Real>(x: R) -> (R, R) {
    use std::f64::consts::{FRAC_2_PI, FRAC_PI_2};
    /// What the double nearest to pi / 2 lacks.
    const REST: f64 = 6.123_233_995_736_766e-17;
    let quarters = round(x * R::splat(FRAC_2_PI));
    let r = (x - quarters * R::splat(FRAC_PI_2)) - quarters * R::splat(REST);
    let y = r * r;
    // Taylor's series, on a quarter of pi either way.
    let sin = r * series(
        y,
        [
            1.0,
            -1.0 / 6.0,
            1.0 / 120.0,
            -1.0 / 5040.0,
            1.0 / 362_880.0,
            -1.0 / 39_916_800.0,
            1.0 / 6_227_020_800.0,
        ],
    );
    let cos = series(
        y,
        [
            1.0,
            -1.0 / 2.0,
            1.0 / 24.0,
            -1.0 / 720.0,
            1.0 / 40_320.0,
            -1.0 / 3_628_800.0,
            1.0 / 479_001_600.0,
        ],
    ) - y * y * y * y * y * y * y * R::splat(1.0 / 87_178_291_200.0);
    // Which quarter it is: -2, -1, 0, 1 or 2.
    let m = quarters - R::splat(4.0) * round(quarters * R::splat(0.25));
    let odd = R::splat(0.5).lt(m.abs()).and(m.abs().lt(R::splat(1.5)));
    let (s, c) = (R::select(odd, cos, sin), R::select(odd, sin, cos));
    let minus_s = m.lt(R::splat(-0.5)).or(R::splat(1.5).lt(m));
    let minus_c = R::splat(0.5).lt(m).or(m.lt(R::splat(-1.5)));
    (R::select(minus_s, -s, s), R::select(minus_c, -c, c))
}

/// Sum of terms times powers of y.
#[inline(always)]
fn series<R: Real>(y: R, terms: [f64; 7]) -> R {
    let mut sum = R::splat(terms[6]);
    for i in (0..6).rev() {
        sum = sum * y + R::splat(terms[i]);
    }
    sum
}

#[cfg(test)]
mod tests {
    //! Rods side by side move as the reduced chain does, and their derivatives are those of differences.

    use super::*;
    use rodgym_core::lane::Lanes;
    use rodgym_core::seed::Stream;

    fn rods() -> Vec<RodDesign> {
        let rod = |width: f64, youngs_modulus: f64| RodDesign {
            width,
            youngs_modulus,
            nodes: 13,
            damping: 1e-3,
            ..RodDesign::default()
        };
        vec![rod(0.006, 1e7), rod(0.009, 1e7), rod(0.007, 6e6)]
    }

    fn bent(stream: &mut Stream) -> State<f64> {
        let mut x = [0.0; STATE];
        x[0] = stream.uniform(-20.0, 20.0);
        x[ORDER] = stream.uniform(-30.0, 30.0);
        for i in 1..ORDER {
            x[i] = stream.uniform(-0.5, 0.5);
            x[ORDER + i] = stream.uniform(-10.0, 10.0);
        }
        x
    }

    fn distance(a: &[f64], b: &[f64]) -> f64 {
        a.iter().zip(b).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max)
    }

    #[test]
    fn sines_and_cosines_are_those_of_libm() {
        let mut stream = Stream::new(1);
        for _ in 0..10_000 {
            let x = stream.uniform(-100.0, 100.0);
            let (sin, cos) = sin_cos(x);
            assert!(
                (sin - libm::sin(x)).abs() < 1e-13 && (cos - libm::cos(x)).abs() < 1e-13,
                "{x}"
            );
        }
    }

    #[test]
    fn accelerations_are_those_of_the_chain() {
        let mut stream = Stream::new(2);
        for rod in rods() {
            let (chain, one) =
                (Chain::new(&rod, ORDER), Rods::<f64>::new(std::slice::from_ref(&rod)));
            for _ in 0..100 {
                let (x, torque) = (bent(&mut stream), stream.uniform(-0.05, 0.05));
                let mut wanted = [0.0; ORDER];
                chain.acceleration(&x[..ORDER], &x[ORDER..], torque, &mut wanted);
                let got = one.acceleration(&x, torque, &Feel::one());
                let size = wanted.iter().fold(1.0, |size: f64, a| size.max(a.abs()));
                assert!(distance(&got, &wanted) < 1e-10 * size, "{got:?} is not {wanted:?}");
            }
        }
    }

    #[test]
    fn slopes_are_those_of_differences() {
        let rod = &rods()[0];
        let rods = Rods::<f64>::new(std::slice::from_ref(rod));
        let mut stream = Stream::new(3);
        for _ in 0..50 {
            let (x, torque) = (bent(&mut stream), stream.uniform(-0.05, 0.05));
            let slope = rods.slope(&x, torque, &Feel::one());
            let check = |column: Coordinates<f64>, h: f64, at: &dyn Fn(f64) -> Coordinates<f64>| {
                let (plus, minus) = (at(h), at(-h));
                let wanted: Vec<f64> =
                    plus.iter().zip(&minus).map(|(p, m)| (p - m) / (2.0 * h)).collect();
                let size = wanted.iter().fold(1.0, |size: f64, a| size.max(a.abs()));
                assert!(distance(&column, &wanted) < 1e-5 * size, "{column:?} is not {wanted:?}");
            };
            for k in 0..ORDER {
                let by = |i: usize| {
                    move |h: f64| {
                        let mut x = x;
                        x[i] += h;
                        x
                    }
                };
                let column = |m: &[Coordinates<f64>; ORDER]| std::array::from_fn(|j| m[j][k]);
                let at = |i: usize, h: f64| rods.acceleration(&by(i)(h), torque, &Feel::one());
                check(column(&slope.angle), 1e-5, &|h| at(k, h));
                check(column(&slope.rate), 1e-4, &|h| at(ORDER + k, h));
            }
            let feel = |stiffness, mobility| Feel { stiffness, mobility };
            let at = |feel: Feel<f64>| rods.acceleration(&x, torque, &feel);
            check(slope.stiffness, 1e-5, &|h| at(feel(libm::exp(h), 1.0)));
            check(slope.mobility, 1e-5, &|h| at(feel(1.0, libm::exp(h))));
        }
    }

    /// Rods in lanes hold the bits of each alone.
    #[test]
    fn lanes_do_not_disturb_each_other() {
        let all = rods();
        let side_by_side = Rods::<Lanes<8>>::new(&all);
        let mut stream = Stream::new(4);
        let states: Vec<State<f64>> = all.iter().map(|_| bent(&mut stream)).collect();
        let mut x: State<Lanes<8>> =
            std::array::from_fn(|i| Lanes::from_fn(|lane| states[lane.min(2)][i]));
        side_by_side.step(&mut x, Lanes::splat(0.02), &Feel::one(), 2e-3);
        for (lane, (rod, state)) in all.iter().zip(states).enumerate() {
            let mut alone = state;
            Rods::<f64>::new(std::slice::from_ref(rod)).step(&mut alone, 0.02, &Feel::one(), 2e-3);
            assert!((0..STATE).all(|i| alone[i].to_bits() == x[i].get(lane).to_bits()));
        }
    }
}
