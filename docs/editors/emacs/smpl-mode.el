;;; smpl-mode.el --- Process models (.eq) -*- lexical-binding: t; -*-

;; Emacs 28 and newer: (load "smpl-mode"), then open a model. `M-x eglot' starts the language server.

;;; Commentary:
;; Colours, comments, and the language server `smpl lsp' by Eglot.

;;; Code:

(defconst smpl-statements
  '("model" "use" "time" "unit" "set" "table" "def" "param" "action" "state" "var" "let" "discrete" "disturbance" "random" "eq" "domain" "flux" "reaction" "connector" "component" "port" "connect" "initial" "steady" "observe" "level" "reward" "fail" "success" "constraint" "invariant" "episode" "solver" "policy" "at" "next" "reset" "clamp" "control" "event" "phase" "test" "expect" "remove" "variant" "choice" "when")
  "Keywords that begin a statement.")

(defconst smpl-clauses
  '("if" "then" "else" "and" "or" "not" "for" "in" "as" "every" "delay" "noise" "scale" "clip" "named" "nonnegative" "prefer" "default" "when" "rate" "until" "over" "cells" "from" "linear" "scheme" "geometry" "stretch" "faces" "areas" "volumes" "periodic" "columns" "event" "at")
  "Keywords inside of a statement.")

(defconst smpl-functions
  '("abs" "acos" "all" "any" "argmax" "argmin" "asin" "atan" "atan2" "ceil" "celsius" "clip" "cos" "cosh" "delay" "der" "div" "erf" "exp" "floor" "grad" "high" "initial" "inside" "integral" "interp" "kelvin" "ln" "log10" "lognormal" "low" "max" "mean" "min" "mod" "nominal" "normal" "outside" "previous" "product" "round" "sampled" "scale" "sign" "sin" "single" "sinh" "smooth" "sq" "sqrt" "steady" "sum" "tan" "tanh" "transport" "uniform" "upwind" "value" "volume" "width")
  "Built-in functions.")

(defvar smpl-mode-syntax-table
  (let ((table (make-syntax-table)))
    (modify-syntax-entry ?# "<" table)
    (modify-syntax-entry ?\n ">" table)
    (modify-syntax-entry ?\" "\"" table)
    (modify-syntax-entry ?_ "_" table)
    table))

(defvar smpl-font-lock
  `((,(concat "\\(?:^\\|[{;]\\)[ \t]*\\(" (regexp-opt smpl-statements) "\\)\\_>") 1 font-lock-keyword-face)
    (,(regexp-opt smpl-clauses 'symbols) . font-lock-keyword-face)
    (,(concat (regexp-opt smpl-functions 'symbols) "[ \t]*(") 1 font-lock-function-name-face)
    ("\\_<[0-9]+\\(?:\\.[0-9]+\\)?\\(?:[eE][+-]?[0-9]+\\)?\\_>" . font-lock-constant-face)))

;;;###autoload
(define-derived-mode smpl-mode prog-mode "smpl"
  "Major mode for process models."
  (setq-local comment-start "# ")
  (setq-local font-lock-defaults '(smpl-font-lock)))

;;;###autoload
(add-to-list 'auto-mode-alist '("\\.eq\\'" . smpl-mode))

(defvar eglot-server-programs)
(with-eval-after-load 'eglot
  (add-to-list 'eglot-server-programs '(smpl-mode . ("smpl" "lsp"))))

(provide 'smpl-mode)
;;; smpl-mode.el ends here
