//! What ours are compared with, if anything is wished for: Embree.

use super::{
    Args,
    builds::{Ground, Timed},
    contender::Built,
    rays::Corners,
};
use crate::cli::error::CliError;

/// Makes those that are compared with over something.
pub type Peers<Over, One> = Box<dyn Fn(&Over) -> Result<Vec<One>, CliError>>;

/// With what they are, in one line.
pub type Described<Over, One> = Result<(Peers<Over, One>, Option<String>), CliError>;

/// Those that are asked by rays.
#[cfg_attr(not(feature = "embree"), expect(unused_variables, reason = "there is no option that asks for any"))]
pub fn to_ask(args: &Args) -> Described<[Corners], Built> {
    #[cfg(feature = "embree")]
    if let Some(path) = &args.embree {
        return super::embree::peers(path);
    }
    none()
}

/// Those that are built again and again.
#[cfg_attr(not(feature = "embree"), expect(unused_variables, reason = "there is no option that asks for any"))]
pub fn to_build(args: &Args) -> Described<Ground, Timed> {
    #[cfg(feature = "embree")]
    if let Some(path) = &args.embree {
        return super::embree::build_peers(path);
    }
    none()
}

fn none<Over: ?Sized, One>() -> Described<Over, One> {
    Ok((Box::new(|_| Ok(Vec::new())), None))
}
