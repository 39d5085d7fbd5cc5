//! t
use virtual_board::*;
struct W { k:[u64;3], out: usize, log: rtt::Decoder, frames: usize }
impl World for W {
  fn next_edge(&mut self, c: usize)->Option<u64>{ self.k[c]+=1; Some(2*((self.k[c] as f64)*90e6/(4898.626-7.0*c as f64)) as u64) }
  fn convert(&mut self,_c:u64)->Option<[i32;8]>{ Some([1000,2000,-3000,0,0,0,0,0]) }
  fn link_out(&mut self,_c:u64,b:&[u8]){ self.out+=b.len(); self.frames+=1; }
  fn log_out(&mut self,c:u64,b:&[u8]){ for l in self.log.push(b) { println!("[{:.4}] {l}", c as f64/180e6); } }
}
fn main(){
  let elf=std::fs::read("target/thumbv7em-none-eabihf/firmware/firmware").unwrap();
  let mut b=Board::new(&elf, W{k:[0;3],out:0,log:rtt::Decoder::new(&elf).unwrap(),frames:0}).unwrap();
  let t=std::time::Instant::now();
  let secs: u64 = std::env::args().nth(1).map_or(3, |s| s.parse().unwrap());
  let r=b.run_until(CPU_HZ*secs);
  println!("{:?} now {} instr {} out {} frames {} wall {:?}", r, b.now(), b.instructions(), b.world.out, b.world.frames, t.elapsed());
}
