//! Runs an ELF for a hundredth of a second and prints, of the last call of a function, its instructions and the cycles that the board
//! estimates: `cycles ELF FUNCTION` (`bench/peers/cycles.py` compares them with published ones).

use virtual_board::{Board, NothingConnected, CPU_HZ};

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let mut arguments = std::env::args().skip(1);
    let (Some(elf), Some(function)) = (arguments.next(), arguments.next()) else {
        return Err("give an ELF and a function".into());
    };
    let mut board = Board::new(&std::fs::read(elf)?, NothingConnected)?;
    board.start_estimate();
    let probe = board.count_calls(&function)?;
    board.run_until(CPU_HZ / 100)?;
    let calls = board.probe(probe).ok_or("not counted")?;
    let (Some(instructions), Some(cycles)) = (calls.calls.last(), calls.estimates.last()) else {
        return Err("the function was not called".into());
    };
    println!("{instructions} {cycles}");
    Ok(())
}
