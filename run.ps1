# .\run.ps1 demo   performs the whole job on the shipped example and writes out\t37\
# .\run.ps1 test   runs the fast test suite
# .\run.ps1 docs   builds the documentation as a site, build\site
# The same as ./run of Linux and macOS. Each makes .venv when it is missing and installs what it needs
# (uv when present, else venv and pip). If Windows refuses scripts:
#   powershell -ExecutionPolicy Bypass -File run.ps1 demo
#
# No param block: with one, PowerShell takes options such as -o and -v for abbreviations of its own
# (-OutVariable, -Verbose) and refuses them before they reach the program.
$verb = [string] $args[0]
$rest = @($args | Select-Object -Skip 1)
$ErrorActionPreference = "Stop"
$python = if ($env:PYTHON) { $env:PYTHON } else { "python" }
# the folder of the programs of an environment
$programs = if ($env:OS -eq "Windows_NT") { ".venv\Scripts" } else { ".venv/bin" }
$suffix = if ($env:OS -eq "Windows_NT") { ".exe" } else { "" }
$inside = Join-Path $programs "python$suffix"

function Stop-Run([string] $Text) {
    [Console]::Error.WriteLine("run: $Text")
    exit 2
}

# Windows PowerShell 5 does not stop at the exit code of a program
function Invoke-Checked([string] $Program, [string[]] $Arguments) {
    & $Program @Arguments
    if ($LASTEXITCODE -ne 0) { exit $LASTEXITCODE }
}

function Test-Python {
    try { & $python -c "import sys; sys.exit(sys.version_info < (3, 11))" 2>$null } catch { return $false }
    return $LASTEXITCODE -eq 0
}

function New-Environment {
    if (Test-Path $inside) { return }
    Write-Host "run: making .venv"
    if (Get-Command uv -ErrorAction SilentlyContinue) {
        Invoke-Checked "uv" @("venv", "-q", "--python", $python, ".venv")
    } else {
        & $python -m venv .venv
        if ($LASTEXITCODE -ne 0) {
            Remove-Item .venv -Recurse -Force -ErrorAction SilentlyContinue
            Stop-Run "Python cannot make an environment; its messages stand above"
        }
    }
}

# install WHAT into the environment, again only when the build's own inputs have changed
function Install-Packages([string] $What, [string] $Name) {
    New-Environment
    $stamp = Join-Path ".venv" ".installed-$Name"
    if (Test-Path $stamp) {
        $since = (Get-Item $stamp -Force).LastWriteTimeUtc
        $files = @(Get-Item "pyproject.toml", "hatch_build.py") + @(Get-ChildItem kernel -Recurse -File)
        if (-not ($files | Where-Object { $_.LastWriteTimeUtc -gt $since })) { return }
    }
    Write-Host "run: installing aeromatch (a compiler from a wheel builds the C kernel)"
    if (Get-Command uv -ErrorAction SilentlyContinue) {
        Invoke-Checked "uv" @("pip", "install", "-q", "--python", $inside, "-e", $What)
    } else {
        # an environment that uv made has no pip
        & $inside -c "import importlib.util, sys; sys.exit(importlib.util.find_spec('pip') is None)"
        if ($LASTEXITCODE -ne 0) { Invoke-Checked $inside @("-m", "ensurepip") }
        Invoke-Checked $inside @("-m", "pip", "install", "-q", "--disable-pip-version-check", "-e", $What)
    }
    Set-Content -Path $stamp -Value ""
}

function Invoke-Verb {
    if (-not (Test-Python)) { Stop-Run "needs Python 3.11 or newer; set PYTHON to one" }
    switch ($verb) {
        "demo" {
            Install-Packages "." "demo"
            & (Join-Path $programs "aeromatch$suffix") demo @rest
            exit $LASTEXITCODE
        }
        "test" {
            Install-Packages ".[dev]" "dev"
            # two processes share the cores; threads of the linear algebra on top of them take twice the time
            if (-not $env:OPENBLAS_NUM_THREADS) { $env:OPENBLAS_NUM_THREADS = "1" }
            & $inside -m pytest tests -n 2 --dist loadfile -m "not slow and not serial" -rs @rest
            exit $LASTEXITCODE
        }
        "docs" {
            Install-Packages ".[docs]" "docs"
            $env:NO_MKDOCS_2_WARNING = "1"
            & $inside -m mkdocs build --strict @rest
            exit $LASTEXITCODE
        }
        default { Stop-Run "found '$verb'; allowed are demo, test and docs" }
    }
}

# A script runs in the session that calls it: folder and environment are put back.
$changed = "PYTHONDONTWRITEBYTECODE", "OPENBLAS_NUM_THREADS", "NO_MKDOCS_2_WARNING"
$before = @{}
foreach ($name in $changed) { $before[$name] = [Environment]::GetEnvironmentVariable($name) }
Push-Location $PSScriptRoot
try {
    # without bytecode every process compiles the packages anew, and the tests start hundreds
    Remove-Item Env:PYTHONDONTWRITEBYTECODE -ErrorAction SilentlyContinue
    Invoke-Verb
} finally {
    Pop-Location
    foreach ($name in $changed) {
        Remove-Item "Env:$name" -ErrorAction SilentlyContinue
        if ($null -ne $before[$name]) { Set-Item "Env:$name" $before[$name] }
    }
}
