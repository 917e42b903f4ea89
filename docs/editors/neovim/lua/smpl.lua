-- Neovim 0.7 and newer. Put the folder above this one on the runtime path, and `require("smpl").setup()` into `init.lua`.

local M = {}

-- The command: the option, else the one of the active Python environment, else the one on the path.
local function command(options)
  if options.command then
    return options.command
  end
  local environment = vim.env.VIRTUAL_ENV
  local own = environment and environment .. "/bin/smpl"
  return { own and vim.fn.executable(own) == 1 and own or "smpl", "lsp" }
end

local function start(buffer, options)
  local name = vim.api.nvim_buf_get_name(buffer)
  local settings = {
    name = "smpl",
    cmd = command(options),
    root_dir = vim.fn.fnamemodify(name, ":p:h"),
    init_options = options.settings or {},
    on_attach = options.on_attach,
  }
  if vim.lsp.start then
    vim.lsp.start(settings)
  else
    M.client = M.client or vim.lsp.start_client(settings)
    vim.lsp.buf_attach_client(buffer, M.client)
  end
end

function M.setup(options)
  options = options or {}
  vim.filetype.add({ extension = { eq = "smpl" } })
  local group = vim.api.nvim_create_augroup("smpl", {})
  vim.api.nvim_create_autocmd({ "BufRead", "BufNewFile" }, {
    group = group,
    pattern = "*.eq",
    callback = function(event)
      vim.bo[event.buf].filetype = "smpl"
      vim.bo[event.buf].commentstring = "# %s"
      vim.bo[event.buf].omnifunc = "v:lua.vim.lsp.omnifunc"
      start(event.buf, options)
    end,
  })
end

return M
