# Warning when a property leaves the range in which it holds.
#
# `place` is 0 at the lower and 1 at the upper end of the range: `eq V.place = place_in(T, antoine_low[water], antoine_high[water])`.
# The event `left` happens once in an episode, at the start too; from then on `warned` is 1. The episode continues.

def place_in(x, low, high) = ((x - low)/(high - low)) as [1]

component ValidRange "event, once in an episode, when a quantity leaves its range" {
  var place : 1 = 0.5    "place in the range, from 0 to 1"
  discrete warned : 1 = 0 in 0..1    "1 after the range was left"
  event left when (if warned >= 0.5 then 1 else min(place, 1 - place)) < 0
  at left { next warned = 1 }
}
