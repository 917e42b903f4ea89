# SYNTAX TEST "source.smpl" "statements, units, numbers and texts"
model Tank "a tank"
# <---- keyword.control.statement.smpl
#          ^^^^^^^^ string.quoted.double.smpl
param k : m^2.5/min = 0.1 in 0..1
# <---- keyword.control.statement.smpl
#                     ^^^ constant.numeric.smpl
#                         ^^ keyword.control.clause.smpl
#                             ^^ keyword.operator.smpl
eq d/dt h = (q - k*sqrt(h)) / 5 [m^2]
# <-- keyword.control.statement.smpl
#  ^^^^ keyword.operator.derivative.smpl
#                  ^^^^ support.function.smpl
#                              ^^^^^^ support.type.unit.smpl
component Mixer { var level : m }
# <--------- keyword.control.statement.smpl
#                 ^^^ keyword.control.statement.smpl
fail low when outside bounds(h)
# <---- keyword.control.statement.smpl
#        ^^^^ keyword.control.clause.smpl
#             ^^^^^^^ support.function.smpl
let state_of_h = h
# <--- keyword.control.statement.smpl
#   ^^^^^ - keyword.control.statement.smpl
