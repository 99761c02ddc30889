"""The paper's program, with its import line changed."""

import ss2sql.compat as SelectScript


def move(step, towers):
    if not towers or not towers[step[0]]:
        pass
    elif not towers[step[1]] or towers[step[1]][-1] > towers[step[0]][-1]:
        # append element on top from another tower top
        towers[step[1]].append(towers[step[0]].pop())
        return towers
    return []


ss = SelectScript.Interpreter()
ss.addFunction("move", move)

problem = """
moves = [[0,1], [0,2], [1,0], [1,2], [2,0], [2,1]];
SELECT this FROM moves WHERE [[],[],[3,2,1]] == move(this, tower)

START WITH tower = [[3,2,1],[],[]],   level=1
CONNECT BY tower = move(this, tower), level=level+1
STOP WITH  level==7 or []==move(this, tower)
AS list;
"""

ir = SelectScript.compile(problem)
result = ss.eval(ir)

if __name__ == "__main__":
    print(result)
