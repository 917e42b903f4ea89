//! Values that need each other, in an order in which they can be computed.

/// The numbers below `count` so that each follows those that it `needs`, and the pairs (one, what it needs) that close a cycle.
pub(super) fn each_after_its_needs(count: usize, mut needs: impl FnMut(usize) -> Vec<usize>) -> (Vec<usize>, Vec<(usize, usize)>) {
    #[derive(Clone, Copy)]
    enum State {
        New,
        Open,
        Done,
    }
    let (mut order, mut cycles) = (Vec::with_capacity(count), Vec::new());
    let mut state = vec![State::New; count];
    // An explicit stack: chains may be long.
    let mut stack: Vec<usize> = (0..count).rev().collect();
    while let Some(&i) = stack.last() {
        match state[i] {
            State::New => {
                state[i] = State::Open;
                for j in needs(i) {
                    match state[j] {
                        State::New => stack.push(j),
                        State::Open => cycles.push((i, j)),
                        State::Done => {}
                    }
                }
            }
            State::Open => {
                stack.pop();
                state[i] = State::Done;
                order.push(i);
            }
            State::Done => {
                stack.pop();
            }
        }
    }
    (order, cycles)
}
