"""A bridge to preCICE 3: a participant of preCICE takes a role of Ripstop.

    python -m ripstop.precice structure --write-config SCENE --config 'precice-{stage}.xml'
    ripstop run SCENE --structure "python -m ripstop.precice structure --config 'precice-{stage}.xml' --solver COMMAND"

See docs/how-to/couple-through-precice.md. `exchange` says how windows of Ripstop become time windows of preCICE.
Nothing else of Ripstop needs preCICE or its Python bindings.
"""
