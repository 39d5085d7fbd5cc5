//! The unit as a network of thermal bodies: board, base plate, and for each gyro a holder, a case and the resonator in its vacuum.
//!
//! ```text
//! air --- base plate --- board (heated by its own power)
//!  |        |  |
//!  |      holder, case --- resonator (stem, and radiation through the vacuum)
//!  +--------+
//! ```
//! The holder is recorded by nobody. Conductances differ by axis and change with temperature: natural convection grows with the difference,
//! radiation with the cube of the absolute temperature.

use crate::draw::Properties;

/// Absolute zero, C.
const ZERO_C: f64 = 273.15;

/// Thermal numbers of one gyro.
#[derive(Clone, Copy, Debug)]
struct Gyro {
    case_to_base_s: f64,
    case_to_air_s: f64,
    case_heat_c_per_s: f64,
    holder_to_base_s: f64,
    holder_heat_c_per_s: f64,
    resonator_s: f64,
    radiation_share: f64,
}

/// Thermal numbers of one unit. Each `_s` is the time constant of one body through one path.
#[derive(Clone, Copy, Debug)]
pub struct Network {
    base_to_air_s: f64,
    base_to_board_s: f64,
    board_to_base_s: f64,
    board_to_air_s: f64,
    board_heat_c_per_s: f64,
    gyros: [Gyro; 3],
}

/// Temperatures of one run, C; ramps in C/min.
#[derive(Clone, Debug, Default)]
pub struct Bodies {
    /// Base plate.
    pub base_c: Vec<f64>,
    /// Electronics board.
    pub board_c: Vec<f64>,
    /// Case of each gyro.
    pub case_c: [Vec<f64>; 3],
    /// Holder of each gyro's pre-amplifier: recorded by nobody.
    pub holder_c: [Vec<f64>; 3],
    /// Resonator of each gyro.
    pub resonator_c: [Vec<f64>; 3],
}

impl Network {
    /// A unit.
    #[must_use]
    pub fn draw(rng: &mut Properties) -> Self {
        let mut gyro = || Gyro {
            case_to_base_s: rng.random_range(150.0..280.0),
            case_to_air_s: rng.random_range(900.0..1600.0),
            case_heat_c_per_s: rng.random_range(0.0008..0.003),
            holder_to_base_s: rng.random_range(900.0..2200.0),
            holder_heat_c_per_s: rng.random_range(0.0005..0.0025),
            resonator_s: rng.random_range(220.0..400.0),
            radiation_share: rng.random_range(0.35..0.65),
        };
        let gyros = [gyro(), gyro(), gyro()];
        Self {
            base_to_air_s: rng.random_range(340.0..520.0),
            base_to_board_s: rng.random_range(600.0..800.0),
            board_to_base_s: rng.random_range(200.0..300.0),
            board_to_air_s: rng.random_range(1200.0..1800.0),
            board_heat_c_per_s: rng.random_range(0.042..0.056),
            gyros,
        }
    }

    /// All bodies under the given air, from a unit that was as warm as the air when power came on.
    #[must_use]
    pub fn run(&self, air_c: &[f64], dt_s: f64) -> Bodies {
        let start = air_c.first().copied().unwrap_or(22.0);
        let (mut base, mut board) = (start, start);
        let (mut case, mut holder, mut resonator) = ([start; 3], [start; 3], [start; 3]);
        let mut out = Bodies::default();
        for &air in air_c {
            let convection = 1.0 + 0.10 * (air - base).abs().sqrt();
            let gyro_flow: f64 = (0..3).map(|a| (case[a] - base) / 6000.0).sum();
            let d_base =
                (air - base) / self.base_to_air_s * convection + (board - base) / self.base_to_board_s + gyro_flow;
            // A colder board draws a little less.
            let power = self.board_heat_c_per_s * (1.0 + 8e-4 * (board - 25.0));
            let d_board = power + (base - board) / self.board_to_base_s + (air - board) / self.board_to_air_s;
            for (a, g) in self.gyros.iter().enumerate() {
                let to_resonator = exchange(case[a], resonator[a], g.radiation_share) / g.resonator_s;
                let d_case = (base - case[a]) / g.case_to_base_s
                    + (air - case[a]) / g.case_to_air_s * convection
                    + g.case_heat_c_per_s
                    - 0.05 * to_resonator;
                let d_holder = (base - holder[a]) / g.holder_to_base_s + g.holder_heat_c_per_s;
                case[a] += dt_s * d_case;
                holder[a] += dt_s * d_holder;
                resonator[a] += dt_s * to_resonator;
                out.case_c[a].push(case[a]);
                out.holder_c[a].push(holder[a]);
                out.resonator_c[a].push(resonator[a]);
            }
            base += dt_s * d_base;
            board += dt_s * d_board;
            out.base_c.push(base);
            out.board_c.push(board);
        }
        out
    }
}

/// Difference that drives heat from `from` to `to`, C: conduction through the stem, and radiation scaled to equal it at 25 C.
fn exchange(from: f64, to: f64, radiation_share: f64) -> f64 {
    let fourth = |c: f64| (c + ZERO_C).powi(4);
    let radiation = (fourth(from) - fourth(to)) / (4.0 * (25.0 + ZERO_C).powi(3));
    (1.0 - radiation_share) * (from - to) + radiation_share * radiation
}
