//! Systematic resampling, in place: every particle is copied once for each evenly spaced mark that falls within its
//! weight (G. Kitagawa, Journal of Computational and Graphical Statistics 5(1), 1996). It takes one random number,
//! two passes, and no second set of particles. The numbers of copies vary less than those of the thesis' multinomial
//! SIR.

use crate::Real;

/// Resamples particles whose weights add up to 1. `start`, from 0 to below 1, positions the marks. `copied` is called
/// for every copy of a particle after the first.
pub(super) fn systematic<T: Real, P: Copy, const N: usize>(
    particles: &mut [P; N],
    start: T,
    weight: impl Fn(&P) -> T,
    mut copied: impl FnMut(&mut P),
) {
    let mut copies = [0_u16; N];
    let (mut reached, mut marked) = (T::ZERO, 0);
    let count = T::count(N);
    for (copies, particle) in copies.iter_mut().zip(particles.iter()) {
        reached += weight(particle) * count;
        while marked < N && T::count(marked) + start < reached {
            *copies += 1;
            marked += 1;
        }
    }
    // The last particle that has copies takes those that rounding left over.
    if let Some(last) = copies.iter_mut().rev().find(|copies| **copies > 0) {
        *last += (N - marked) as u16;
    }
    let mut source = 0;
    for place in 0..N {
        if copies.get(place).is_none_or(|copies| *copies > 0) {
            continue;
        }
        while copies.get(source).is_some_and(|copies| *copies < 2) {
            source += 1;
        }
        if let (Some(surplus), Some(&particle)) = (copies.get_mut(source), particles.get(source)) {
            *surplus -= 1;
            if let Some(dead) = particles.get_mut(place) {
                *dead = particle;
                copied(dead);
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::systematic;

    #[test]
    fn copies_are_as_many_as_the_weights_say() {
        // Marks at 0.5, 1.5 … 4.5 of the weights times five, which reach 2.5, 2.5, 3.0, 4.75, 5: two, none, one, two,
        // none.
        let mut particles = [('a', 0.5), ('b', 0.0), ('c', 0.1), ('d', 0.35), ('e', 0.05)];
        let mut copied = 0;
        systematic(&mut particles, 0.5_f64, |particle| particle.1, |_| copied += 1);
        let mut names = particles.map(|particle| particle.0);
        names.sort_unstable();
        assert_eq!((names, copied), (['a', 'a', 'c', 'd', 'd'], 2));
    }

    #[test]
    fn weights_that_rounding_left_short_of_one_fill_all_places() {
        let mut particles = [('a', 0.0_f64), ('b', 0.4), ('c', 0.3)];
        systematic(&mut particles, 0.9, |particle| particle.1, |_| ());
        assert!(particles.iter().all(|particle| particle.0 != 'a'), "{particles:?}");
    }
}
