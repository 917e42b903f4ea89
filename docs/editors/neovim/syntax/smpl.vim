" Colours of models (.eq).
if exists("b:current_syntax")
  finish
endif

syntax match smplComment "#.*$"
syntax region smplText start=+"+ end=+"+ oneline
syntax match smplNumber "\<[0-9]\+\(\.[0-9]\+\)\=\([eE][+-]\=[0-9]\+\)\=\>"
syntax match smplUnit "\([0-9]\s\=\)\@<=\[[^]]*\]"
syntax match smplStatement "\(^\s*\|[{;]\s*\)\@<=\(model\|use\|time\|unit\|set\|table\|def\|param\|action\|state\|var\|let\|discrete\|disturbance\|random\|eq\|domain\|flux\|reaction\|connector\|component\|port\|connect\|initial\|steady\|observe\|level\|reward\|fail\|success\|constraint\|invariant\|episode\|solver\|policy\|at\|next\|reset\|clamp\|control\|event\|phase\|test\|expect\|remove\|variant\|choice\|when\)\>\(\s\+[A-Za-z\"{(]\|\s*{\)\@="
syntax match smplClause "\<\(if\|then\|else\|and\|or\|not\|for\|in\|as\|every\|delay\|noise\|scale\|clip\|named\|nonnegative\|prefer\|default\|when\|rate\|until\|over\|cells\|from\|linear\|scheme\|geometry\|stretch\|faces\|areas\|volumes\|periodic\|columns\|event\|at\)\>\(\s*[=.\[]\)\@!"
syntax match smplFunction "\<\(abs\|acos\|all\|any\|argmax\|argmin\|asin\|atan\|atan2\|ceil\|celsius\|clip\|cos\|cosh\|delay\|der\|div\|erf\|exp\|floor\|grad\|high\|initial\|inside\|integral\|interp\|kelvin\|ln\|log10\|lognormal\|low\|max\|mean\|min\|mod\|nominal\|normal\|outside\|previous\|product\|round\|sampled\|scale\|sign\|sin\|single\|sinh\|smooth\|sq\|sqrt\|steady\|sum\|tan\|tanh\|transport\|uniform\|upwind\|value\|volume\|width\)\>\(\s*(\)\@="
syntax keyword smplConstant true false inf pi

highlight default link smplComment Comment
highlight default link smplText String
highlight default link smplNumber Number
highlight default link smplUnit Type
highlight default link smplStatement Keyword
highlight default link smplClause Statement
highlight default link smplFunction Function
highlight default link smplConstant Constant

let b:current_syntax = "smpl"
