-- Run by `editors.rs` in `nvim --headless`: arguments are the command, the folder of the set-up, and a model with one fault.

local command, setup, file = vim.env.SMPL_COMMAND, vim.env.SMPL_SETUP, vim.env.SMPL_MODEL
vim.opt.runtimepath:append(setup)
require("smpl").setup({ command = { command, "lsp" } })

local function fail(message)
  io.stderr:write("FAILED " .. message .. "\n")
  vim.cmd("cquit 1")
end

local function check(holds, message)
  if not holds then
    fail(message)
  end
end

local function wait(what, condition)
  check(vim.wait(60000, condition, 20), "waited in vain for " .. what)
end

vim.cmd("edit " .. vim.fn.fnameescape(file))
local buffer = vim.api.nvim_get_current_buf()

-- Answers of the server to a request about a place (line from 1, column from 0).
local function ask(method, line, column, more)
  vim.api.nvim_win_set_cursor(0, { line, column })
  local params = vim.lsp.util.make_position_params()
  for key, value in pairs(more or {}) do
    params[key] = value
  end
  local answers = vim.lsp.buf_request_sync(buffer, method, params, 60000)
  for _, answer in pairs(answers or {}) do
    check(not answer.error, method .. ": " .. vim.inspect(answer.error))
    return answer.result
  end
  fail(method .. " was not answered")
end

local function find(text)
  for number, line in ipairs(vim.api.nvim_buf_get_lines(buffer, 0, -1, false)) do
    local at = line:find(text, 1, true)
    if at then
      return number, at - 1
    end
  end
  fail(text .. " is not in the text")
end

-- Diagnostics appear, and go when the fault is removed.
wait("a diagnostic", function() return #vim.diagnostic.get(buffer) == 1 end)
local found = vim.diagnostic.get(buffer)[1]
check(found.code == "E0201-unknown-name" or found.message:find("unknown name `outt`", 1, true), vim.inspect(found))
local line, column = find("outt")
check(found.lnum == line - 1 and found.col == column, "the place of the diagnostic is wrong: " .. vim.inspect(found))
vim.api.nvim_buf_set_text(buffer, line - 1, column, line - 1, column + 4, { "out" })
wait("no diagnostic", function() return #vim.diagnostic.get(buffer) == 0 end)

-- Hover.
line, column = find("h = (q")
local hover = ask("textDocument/hover", line, column)
check(hover.contents.value:find("length [m]", 1, true), vim.inspect(hover))

-- Completion.
line, column = find("out) / A")
local items = vim.lsp.util.extract_completion_items(ask("textDocument/completion", line, column + 2))
local labels = vim.tbl_map(function(item) return item.label end, items)
check(vim.tbl_contains(labels, "out") and vim.tbl_contains(labels, "sqrt"), vim.inspect(labels))

-- Rename, by the client itself.
line, column = find("out           =")
vim.api.nvim_win_set_cursor(0, { line, column })
vim.lsp.buf.rename("drain")
wait("the new name", function()
  local text = table.concat(vim.api.nvim_buf_get_lines(buffer, 0, -1, false), "\n")
  return text:find("let    drain", 1, true) and text:find("(q - drain) / A", 1, true)
end)

-- Format, by the client itself.
line = find("initial")
vim.api.nvim_buf_set_lines(buffer, line - 1, line, false, { "initial   h~uniform(0.5, 1.5)" })
local format = vim.lsp.buf.formatting_sync or function() vim.lsp.buf.format({ timeout_ms = 60000 }) end
format({}, 60000)
check(vim.api.nvim_buf_get_lines(buffer, line - 1, line, false)[1] == "initial h ~ uniform(0.5, 1.5)", "the line was not laid out")

io.stdout:write("diagnostics, hover, completion, rename, format: passed\n")
vim.cmd("qall!")
