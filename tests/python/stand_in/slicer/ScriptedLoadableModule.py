"""The classes that a scripted module of 3D Slicer derives from."""


class ScriptedLoadableModule:
    def __init__(self, parent):
        self.parent = parent


class ScriptedLoadableModuleLogic:
    pass


class ScriptedLoadableModuleWidget:
    pass
